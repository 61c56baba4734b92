#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails where a Python module from static libraries is linked with what decodes images: check_module.sh FILE
set -euo pipefail
needed=$(readelf -d "$1" | grep NEEDED)
if grep -E 'imgcodecs|videoio|libzip|libjpeg|libpng' <<<"$needed"; then
  echo "check_module.sh: $1 needs decoders of images" >&2
  exit 1
fi
