#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Tries the wheels of out/wheels in roots that have Python and nothing else: try.sh [SUITE...] (default bullseye bookworm
# trixie, made by debootstrap; as root). Each installs the wheel by pip and runs `dsorb run clip.mp4` on a rendered clip; the
# trajectory has to be the same everywhere. Says how long it takes from an empty environment to the trajectory.
set -euo pipefail
cd "$(dirname "$0")/../.."
wheels=$PWD/out/wheels roots=$(mkdir -p "${DSORB_CACHE:-.cache/wheels}/roots" && readlink -f "${DSORB_CACHE:-.cache/wheels}/roots")
[ $# -gt 0 ] || set -- bullseye bookworm trixie
clip=${DSORB_CLIP:-}
if [ -z "$clip" ]; then
  clip=$roots/clip.mp4
  [ -e "$clip" ] || scripts/wheels/clip.sh "$clip"
fi
expected=
for suite; do
  root=$roots/$suite
  [ -e "$root/usr/bin/python3" ] || debootstrap --variant=minbase --include=python3,python3-venv,ca-certificates "$suite" "$root" http://deb.debian.org/debian >/dev/null
  rm -rf "$root/try" && mkdir "$root/try"
  cp "$wheels"/*x86_64.whl "$clip" "$root/try/"
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  [ ! -e /etc/pip.conf ] || cp /etc/pip.conf "$root/etc/"
  cp -r /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
  begin=$(date +%s.%N)
  unshare -m bash -c 'mount -t proc proc "$1/proc"; mount --bind /dev "$1/dev"; exec chroot "$1" /bin/sh -ec "
    cd /try
    export HOME=/try PIP_DISABLE_PIP_VERSION_CHECK=1
    python3 -m venv venv
    venv/bin/pip install -q --find-links /try dsorb
    venv/bin/python -c \"import dsorb, sys; print(sys.version.split()[0], dsorb.__version__)\"
    venv/bin/dsorb run '"$(basename "$clip")"' --hfov 77 --output out --quiet
    cut -d\" \" -f1-8 out/trajectory.txt | wc -l"' _ "$root"
  echo "$suite: $(awk -v a="$begin" -v b="$(date +%s.%N)" 'BEGIN { printf "%.0f", b - a }') s from an empty environment to the trajectory"
  sum=$(md5sum <"$root/try/out/trajectory.txt")
  [ "${expected:=$sum}" = "$sum" ] || { echo "try.sh: $suite has another trajectory" >&2; exit 1; }
done
