#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds everything and runs all tests. Arguments go to ctest (-L unit, -R name, ...).
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/install_dependencies.sh
# shellcheck disable=SC2046 # several flags or none
scripts/build.sh -DDSORB_BUILD_TESTS=ON $(scripts/python_flags.sh) ${DSORB_CMAKE_FLAGS:-}
ctest --test-dir "${DSORB_BUILD_DIR:-build}" --output-on-failure --parallel "$(nproc)" "$@"
