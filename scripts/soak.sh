#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# A long run through everything that happens to a camera: soak.sh [FRAMES [WORK_FOLDER]], default 20000 frames.
# Renders two rooms of 160x120 px under several lights (once), makes the sequence of them (soak.py), runs dso_dataset over
# it and judges what came out. Leaves the figure soak.svg in the work folder.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
bin=${DSORB_BUILD_DIR:-$here/../build}/bin
frames=${1:-20000}
work=${2:-$(mktemp -d)}
walk=300 # frames of a room, gone there and back

render() { # FOLDER KIND SEED FRAMES LIGHT
  [ -e "$work/$1/camera.txt" ] && return
  "$bin/dso_synthesize" "$2" --output "$work/$1" --seed "$3" --frames "$4" --light "$5" --width 160 --height 120 --quiet
}
for room in 3 4; do
  for light in 1 0.5 0.125 0.02; do render "room_${room}_$light" room $room $walk $light; done
  render "standing_$room" static $room 60 1
  render "turning_$room" rotation $room 63 1
done
exec python3 "$here/soak.py" --program "$bin/dso_dataset" --frames "$frames" --walk "$walk" "$work"
