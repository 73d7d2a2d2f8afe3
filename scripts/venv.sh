# Sourced by the commands beside it: makes .venv with what they need, once, and activates it.
# usage: . scripts/venv.sh EXTRA ...    (base: the package without extras)
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
if ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
  for candidate in python3.11 python3.12 python3.13 python3.14 python3; do
    if command -v "$candidate" >/dev/null &&
      "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      python=$candidate
      break
    fi
  done
  [ -n "${python:-}" ] || { echo "Python 3.11 or newer is needed" >&2; exit 1; }
  "$python" -m venv --clear "$venv"
fi
. "$venv/bin/activate"
absent='' stamps=()
for extra in "$@"; do
  stamp=$venv/.installed-$extra
  for file in pyproject.toml setup.cfg setup.py constraints.txt; do # what an installation depends on
    if [ ! -f "$stamp" ] || [ "$root/$file" -nt "$stamp" ]; then
      stamps+=("$stamp")
      [ "$extra" = base ] || absent+=${absent:+,}$extra
      break
    fi
  done
done
if [ "${#stamps[@]}" != 0 ]; then
  what=.${absent:+[$absent]}
  echo "installing pacman_env${what#.} into .venv ..." >&2
  # What is imported is compiled by then, which is a third of what is installed.
  (cd "$root" && python -m pip install --quiet --disable-pip-version-check --no-compile --editable "$what" \
    --constraint constraints.txt)
  touch "${stamps[@]}"
fi
