"""Generate C, C++ and Python sources from the definitions of one package, with ROS's own generators.

Run ``python -m tools.ros_interfaces.generate FOLDER OUT`` in a separate process for each package: the generators keep
state between calls and print. They are called as functions, because the wheels' ``rosidl`` command fails.
"""

import json
import sys
from pathlib import Path
from typing import Any

from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_adapter.srv import convert_srv_to_idl
from rosidl_generator_c import generate_c
from rosidl_generator_py import generate_py
from rosidl_generator_type_description import generate_type_hash
from rosidl_typesupport_c import generate_c as generate_typesupport_c
from rosidl_typesupport_fastrtps_c import generate_typesupport_fastrtps_c
from rosidl_typesupport_introspection_c import generate_c as generate_introspection_c

SHARE = Path(sys.prefix) / "share"
FAST = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"  # FastDDS's middleware needs it to register a type
TO_IDL = {".msg": convert_msg_to_idl, ".srv": convert_srv_to_idl, ".action": convert_action_to_idl}


def generate(folder: Path, out: Path) -> None:
    """Write ``out/GENERATOR/PACKAGE/...`` for all definitions below ``folder``, which is named after the package."""
    package = folder.name
    files = sorted(path for kind in TO_IDL for path in folder.glob(f"{kind[1:]}/*{kind}"))
    interfaces = []
    for path in files:
        relative = path.relative_to(folder)
        target = out / "idl" / relative.parent
        target.mkdir(parents=True, exist_ok=True)
        TO_IDL[path.suffix](folder, package, relative, target)
        interfaces.append(relative.with_suffix(".idl"))

    def arguments(generator: str, **more: Any) -> str:
        path = out / f"{generator}.json"
        settings = {
            "package_name": package,
            "idl_tuples": [f"{out / 'idl'}:{name.as_posix()}" for name in interfaces],
            "output_dir": str(out / generator / package),
            "template_dir": str(SHARE / generator / "resource"),
            "target_dependencies": [],
            "ros_interface_dependencies": [],
            **more,
        }
        path.write_text(json.dumps(settings))
        return str(path)

    hashes = out / "hashes"
    installed = [f"{path.parent.name}:{path.parent}" for path in sorted(SHARE.glob("*/msg"))]
    generate_type_hash(arguments("rosidl_generator_type_description", output_dir=str(hashes), include_paths=installed))
    described = [f"{name.as_posix()}:{hashes / name.with_suffix('.json')}" for name in interfaces]
    sources = [str(path) for path in files]
    generate_c(arguments("rosidl_generator_c", type_description_tuples=described, ros_interface_files=sources))
    generate_typesupport_fastrtps_c(arguments(FAST))
    generate_introspection_c(arguments(INTROSPECTION))
    generate_typesupport_c(arguments("rosidl_typesupport_c"), [FAST, INTROSPECTION])
    generate_py(arguments("rosidl_generator_py"), ["rosidl_typesupport_c"])
    (out / "rosidl_generator_py" / package / "__init__.py").touch()
    for generator in ("rosidl_generator_c", FAST, INTROSPECTION):
        name = f"{generator}__visibility_control.h"
        text = (SHARE / generator / "resource" / f"{name}.in").read_text()
        text = text.replace("@PROJECT_NAME@", package).replace("@PROJECT_NAME_UPPER@", package.upper())
        target = out / generator / package / "msg"
        target.mkdir(exist_ok=True)
        (target / name).write_text(text)


if __name__ == "__main__":
    generate(Path(sys.argv[1]), Path(sys.argv[2]))
