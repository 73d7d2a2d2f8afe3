"""Compile kernels, Chipmunk and a mathematical library to one WebAssembly module without imports."""

import hashlib
import re
import subprocess
import sys
import tarfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from pacman_env.engine.native import RANGE, address_of_kernel

#: Bytes of memory before the prepared map: code's constants, stack and heap. The page adds memory for the map.
BASE = 4 << 20
_TRIPLE = "wasm32-unknown-unknown"
_FEATURES = "+simd128,+bulk-memory,+mutable-globals,+sign-ext,+nontrapping-fptoint"
_HERE = Path(__file__).parent
_LONGEST_NAME = 400  # LLVM cuts names that are longer


def build(kernels: Mapping[str, Any], exports: Sequence[str], folder: Path) -> Path:
    """Write ``game.wasm`` into a folder from kernels ``(table, first, last) -> int64`` by their exported names.

    ``exports`` are names of C functions to export, of runtime.c or the mathematical library.
    """
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    objects = []
    for name, kernel in kernels.items():
        objects.append(folder / f"{name}.o")
        objects[-1].write_bytes(_object(_code(kernel, name)))
    chipmunk = _chipmunk(folder)
    sources = [path for path in sorted((chipmunk / "src").glob("*.c")) if path.name != "cpHastySpace.c"]  # for threads
    out = folder / "game.wasm"
    command = [
        *(sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-wasi", "-mexec-model=reactor"),
        *("-O2", "-ffp-contract=off", "-DNDEBUG", "-DCP_OVERRIDE_MESSAGE", "-w", "-s", f"-I{chipmunk / 'include'}"),
        *(f"-Wl,--export={name}" for name in (*kernels, *exports)),
        *("-Wl,--export-table", "-Wl,--growable-table", f"-Wl,--initial-memory={BASE}", "-Wl,-z,stack-size=1048576"),
        *map(str, (*objects, _HERE / "runtime.c", *sources)),
        *("-o", str(out)),
    ]
    subprocess.run(command, check=True)
    return out


def _code(kernel: Any, name: str) -> str:
    """Return the LLVM code of a kernel, which gets the name ``name``, for a browser.

    Numba keeps this code with the machine code, also on disk, so nothing is compiled for this machine again.
    """
    address_of_kernel(kernel)
    compiled = kernel.overloads[RANGE]
    code = str(compiled.library._get_module_for_linking()).replace(compiled.fndesc.llvm_func_name, name)
    # The code counts bytes as on a machine with 64-bit addresses, so records on the stack keep that size.
    code = re.sub(r"(= alloca \{)([^}]*)\}", lambda found: f"{found[1]}{found[2].replace('ptr', 'i64')}}}", code)
    # Numba counts references by an instruction of x86 that reports whether the count is 0.
    code = re.sub(r"declare i8 @llvm\.x86\.atomic\.sub\.cc\.i64.*", "declare i8 @count_down(ptr, i64, i32)", code)
    return code.replace("llvm.x86.atomic.sub.cc.i64", "count_down")


def _object(code: str) -> bytes:
    machine = llvm.Target.from_triple(_TRIPLE).create_target_machine(opt=2, reloc="static", features=_FEATURES)
    code = re.sub('target triple = ".*"', f'target triple = "{_TRIPLE}"', code)
    code = re.sub('target datalayout = ".*"', f'target datalayout = "{machine.target_data}"', code)
    code = re.sub('"target-(cpu|features)"="[^"]*"', "", code).replace("= common ", "= weak ")
    too_long = rf"[\w.$-]{{{_LONGEST_NAME},}}"
    code = re.sub(too_long, lambda found: "h" + hashlib.sha256(found[0].encode()).hexdigest(), code)
    module = llvm.parse_assembly(code)
    module.verify()
    result: bytes = machine.emit_object(module)
    return result


def _chipmunk(folder: Path) -> Path:
    """Return the folder of Chipmunk's sources, from the source package of the installed pymunk, loaded once."""
    name = f"pymunk-{version('pymunk')}"
    if not (folder / name).is_dir():
        options = "-qq", "--no-deps", "--no-binary=pymunk", f"--dest={folder}"
        subprocess.run([sys.executable, "-m", "pip", "download", *options, name.replace("-", "==")], check=True)
        with tarfile.open(folder / f"{name}.tar.gz") as package:
            package.extractall(folder, filter="data")
    return folder / name / "Munk2D"
