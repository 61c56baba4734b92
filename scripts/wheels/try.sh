#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Tries the wheels of out/wheels in roots that have Python and nothing else: try.sh [SUITE...] (default bullseye jammy
# bookworm noble trixie, which have Python 3.9 to 3.13; packages of debootstrap, as root). Each installs the wheel by pip, runs
# `dsorb run clip.mp4` on a rendered clip, then the Python example of README.md. The trajectories have to agree. Says how
# long it takes from an empty environment to the trajectory. Needs build/bin/dso_synthesize, see clip.sh. With
# DSORB_ARCH=aarch64 the root is a Debian for arm64 under qemu-user-static, and the camera is given, which spares an hour.
set -euo pipefail
cd "$(dirname "$0")/../.."
wheels=$PWD/out/wheels roots=$(mkdir -p "${DSORB_CACHE:-.cache/wheels}/roots" && readlink -f "${DSORB_CACHE:-.cache/wheels}/roots")
arch=${DSORB_ARCH:-$(uname -m)} options=
[ "$arch" = "$(uname -m)" ] || options='--calib camera.txt --to 2.1'
[ $# -gt 0 ] || set -- bullseye jammy bookworm noble trixie
[ -e "$roots/clip/clip.mp4" ] || scripts/wheels/clip.sh "$roots/clip"
sed -n '/^```python/,/^```/p' README.md | grep -v '^```' >"$roots/clip/readme.py"

# make_root SUITE ROOT: makes it where it is not there; packages are unpacked, which is all that Python needs
make_root() {
  local root=$2 mirror=http://deb.debian.org/debian script=/usr/share/debootstrap/scripts/$1 package debian=amd64
  [ ! -e "$root/done" ] || return 0
  case $1 in jammy | noble) mirror=http://archive.ubuntu.com/ubuntu ;; esac
  [ -e "$script" ] || script=/usr/share/debootstrap/scripts/gutsy # of all Ubuntus
  [ "$arch" = x86_64 ] || debian=arm64
  debootstrap --arch=$debian --download-only --variant=minbase --components=main,universe --include=python3,python3-venv,ca-certificates \
    "$1" "$root.packages" $mirror "$script" >"$root.log"
  mkdir -p "$root"/{proc,dev,tmp,usr/{bin,sbin,lib,lib64}}
  ln -sfn usr/bin usr/sbin usr/lib usr/lib64 "$root/"
  for package in "$root.packages"/var/cache/apt/archives/*.deb; do dpkg-deb -x "$package" "$root"; done
  ln -sfn dash "$root/usr/bin/sh"
  touch "$root/done"
}

# inside ROOT SCRIPT [ARGUMENTS...]; programs of another machine run by qemu, whose registration ends with this namespace
inside() {
  local namespaces=(--mount)
  [ "$arch" = "$(uname -m)" ] || namespaces+=(--user --map-root-user)
  # shellcheck disable=SC2016 # words of the shell inside
  unshare "${namespaces[@]}" bash -c 'set -e
    [ "$1" = "$(uname -m)" ] || { mount -t binfmt_misc none /proc/sys/fs/binfmt_misc; cat "/usr/lib/binfmt.d/qemu-$1.conf" >/proc/sys/fs/binfmt_misc/register; }
    mount --rbind /proc "$2/proc"; mount --rbind /dev "$2/dev"; exec env -i PATH=/usr/sbin:/usr/bin:/bin chroot "$2" /bin/sh "${@:3}"' _ "$arch" "$@"
}

for suite; do
  root=$roots/$suite-$arch
  make_root "$suite" "$root"
  rm -rf "$root/try" && mkdir "$root/try"
  cp -r "$wheels"/*"$arch".whl "$roots"/clip/* "$root/try/"
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  [ ! -e /etc/pip.conf ] || cp /etc/pip.conf "$root/etc/"
  cp -r /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
  cat >"$root/try/try.sh" <<'END'
set -e
cd /try
export HOME=/try PIP_DISABLE_PIP_VERSION_CHECK=1
python3 -m venv venv
venv/bin/pip install -q --find-links /try dsorb
venv/bin/dsorb run clip.mp4 $1 --output out >run.txt 2>&1 || { cat run.txt; exit 1; }
date +%s.%N >end
venv/bin/python -c "import dsorb, sys; print(sys.version.split()[0], dsorb.__version__)"
venv/bin/dsorb --help >help.txt
venv/bin/dsorb metric out --distance 10 60 1.5
venv/bin/pip install -q Pillow
{ cat readme.py; echo 'print(estimate)'; } >example.py
venv/bin/python example.py >example.txt
tail -2 example.txt
END
  begin=$(date +%s.%N)
  inside "$root" /try/try.sh "$options"
  echo "$suite: $(awk -v a="$begin" -v b="$(cat "$root/try/end")" 'BEGIN { printf "%.0f", b - a }') s from an empty environment to the trajectory"
  [ -e "$roots/expected-$arch.txt" ] && [ "$suite" != "$1" ] || cp "$root/try/out/trajectory.txt" "$roots/expected-$arch.txt"
  # Libraries of mathematics differ in the last digit from one libc to the next.
  paste -d' ' "$roots/expected-$arch.txt" "$root/try/out/trajectory.txt" | awk -v suite="$suite" '
    { for (i = 1; i <= 8; i++) if (($i - $(i + 8)) ^ 2 > 1e-6) { print "try.sh: " suite " has another pose in line " NR; exit 1 } }
    END { print NR " poses" }'
done
