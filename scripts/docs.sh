#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Checks the pages and makes the reference of the public headers: docs.sh [OUTPUT_DIR] (default build/docs). Where a
# program is built (DSORB_BUILD_DIR, default build), docs/configuration.md is compared with it. Doxygen's warnings are errors.
set -euo pipefail
cd "$(dirname "$0")/.."
output=${1:-build/docs}

python3 scripts/check_docs.py
program=${DSORB_BUILD_DIR:-build}/bin/dso_dataset
[ ! -x "$program" ] || python3 scripts/configuration_reference.py "$program" --check
scripts/install_dependencies.sh doxygen
mkdir -p "$output"
{ cat docs/Doxyfile; echo "OUTPUT_DIRECTORY = $output"; } | doxygen -
echo "docs: $output/html/index.html"
