#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Renders a room: clip.sh FOLDER makes clip.mp4 (H.264), images/ and camera.txt in it. Needs build/bin/dso_synthesize, and an
# ffmpeg or the Python package imageio-ffmpeg, which brings one.
set -euo pipefail
synthesize=${DSO_SYNTHESIZE:-$(dirname "$0")/../../build/bin/dso_synthesize}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$synthesize" room --output "$work/room" --frames 90 --width 640 --height 480 --quiet
encoder=$(command -v ffmpeg || "${DSORB_PYTHON:-python3}" -c 'import imageio_ffmpeg; print(imageio_ffmpeg.get_ffmpeg_exe())')
mkdir -p "$1"
"$encoder" -v error -y -framerate 30 -pattern_type glob -i "$work/room/images/*.png" -pix_fmt yuv420p -crf 18 "$1/clip.mp4"
mv "$work/room/images" "$work/room/camera.txt" "$1/"
