#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes the virtual environment of the scripts from requirements.txt; does nothing where it is up to date.
# Where: $DSORB_VENV, else .venv beside this project's README. Which Python: $PYTHON, else python3.
# Prints the path of its Python. Exit code 77: it cannot be made (no venv module, no package index).
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
venv=${DSORB_VENV:-$here/../.venv}
wanted=$(cat "$here/requirements.txt" "$here/constraints.txt" | sha256sum | cut -d' ' -f1)

give_up() { echo "venv.sh: $1" >&2; exit 77; }
mkdir -p "$(dirname "$venv")"
exec 9>"$venv.lock" && flock 9
if [ "$(cat "$venv/requirements.sha256" 2>/dev/null)" != "$wanted" ]; then
  echo "Making the virtual environment of the scripts in $venv ..." >&2
  "${PYTHON:-python3}" -m venv "$venv" >&2 || give_up "no virtual environment; on Debian: apt-get install python3-venv"
  "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$here/requirements.txt" >&2 || give_up "packages could not be installed"
  echo "$wanted" >"$venv/requirements.sha256"
fi
echo "$venv/bin/python"
