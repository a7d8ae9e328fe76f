#!/usr/bin/env bash
# Everything the project needs on a bare Debian or Ubuntu: system libraries, .venv, pinned packages.
# A second call with nothing changed ends at once.
set -euo pipefail
cd "$(dirname "$0")/.."

fits() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; }
version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true; }

# PYTHON names the interpreter; without it the one that .venv was made with stays.
python=${PYTHON:-}
if [ -n "$python" ]; then
  if ! fits "$python"; then
    echo "PYTHON: expected Python 3.11, 3.12 or 3.13, received $python ($("$python" --version 2>&1 | head -n 1 || true))" >&2
    exit 2
  fi
else
  for candidate in .venv/bin/python python3.11 python3.12 python3.13 python3; do
    if command -v "$candidate" >/dev/null && fits "$candidate"; then
      python=$candidate
      break
    fi
  done
fi

# What Open3D and VTK load at run time, and what a bare python3 lacks to make a virtual environment.
missing=()
libraries=$(/sbin/ldconfig -p)
need() { grep -q "$1" <<<"$libraries" || missing+=("$2"); }
need libusb-1.0.so.0 libusb-1.0-0
need libgomp.so.1 libgomp1
need libGL.so.1 libgl1
need libEGL.so.1 libegl1
need libX11.so.6 libx11-6
if [ -z "$python" ]; then
  missing+=(python3 python3-venv)
elif ! "$python" -c 'import ensurepip' 2>/dev/null; then
  missing+=("python$(version "$python")-venv")
fi
if [ ${#missing[@]} -gt 0 ]; then
  as_root=()
  [ "$(id -u)" = 0 ] || as_root=(sudo -n)
  if ! command -v apt-get >/dev/null || { [ "$(id -u)" != 0 ] && ! sudo -n true 2>/dev/null; }; then
    echo "System libraries are missing. Run this, then again what you ran:" >&2
    echo "  sudo apt-get update && sudo apt-get install -y ${missing[*]}" >&2
    exit 1
  fi
  echo "Installing system libraries: ${missing[*]}"
  "${as_root[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
  python=${python:-python3}
fi

stamp=$( { cat pyproject.toml constraints.txt scripts/setup.sh; version "$python"; pwd; } | sha256sum)
if [ -x .venv/bin/ctus ] && [ "$(cat .venv/.setup-stamp 2>/dev/null)" = "$stamp" ]; then
  exit 0
fi

echo "Installing the project into .venv: some hundred packages, 4 GB with CUDA's, nothing more is said for 3 to 10 minutes the first time"
# Packages built for another version of Python are of no use: such a .venv is made afresh.
if [ "$(version .venv/bin/python)" != "$(version "$python")" ]; then
  "$python" -m venv --clear .venv
fi
# The pins name torch without a build: an index of CPU builds given in PIP_EXTRA_INDEX_URL wins over the default one.
.venv/bin/python -m pip install --quiet --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
# What is built against libraries that the system lacks is better found now than by the first study.
if ! fault=$(.venv/bin/python -c 'import open3d, vtkmodules.vtkCommonCore' 2>&1); then
  echo "Open3D or VTK does not load: $(tail -n 1 <<<"$fault")" >&2
  exit 1
fi
# Containers often forbid Python to keep byte code; every call would compile the project anew.
.venv/bin/python -m compileall -q src
echo "$stamp" >.venv/.setup-stamp
