#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs one test module in the environment of scripts/venv.sh: run.sh MODULE. Exit code 77: there is none, ctest skips.
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
python=$("$here/../../scripts/venv.sh") || { echo "SKIPPED: the scripts' environment cannot be made here"; exit 77; }
export PYTHONPATH=$here/../../scripts:$here PYTHONDONTWRITEBYTECODE=1 MPLBACKEND=Agg
exec "$python" -W error::ResourceWarning -m unittest "$1"
