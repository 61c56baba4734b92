#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Does the memory of dso_dataset grow with the length of the sequence? Renders some frames of a room (once), runs on
them there and back again until the sequence is long enough, and compares resident memory at an early frame with that at
the end. With --cuts the camera jumps into another room now and then: every jump is a loss and a new start.

    scripts/check_memory.py --bin build/bin --work /tmp/memory [--frames 3000 --early 600 --size 240x180] [-- extra]
"""
import argparse
import pathlib
import statistics
import subprocess
import sys
import time

SPAN = 100  # frames over which the median is taken: memory goes up and down with every keyframe
POSE = 112 / 2**20  # [MiB] that a frame leaves behind in the program


def resident_mb(pid):
    for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return None  # the process has just ended


def watch(process, table, period=0.02):
    """Samples (frames done, MiB) until the process ends."""
    samples, done, position = [], -1, 0  # the first line is the header
    while process.poll() is None:
        if table.exists():
            with table.open("rb") as file:
                file.seek(position)
                text = file.read()
            position += len(text)
            done += text.count(b"\n")
            memory = resident_mb(process.pid)
            if memory is not None:
                samples.append((done, memory))
        time.sleep(period)
    return samples


def long_sequence(options):
    """A sequence in the layout of TUM RGB-D, whose list may name an image as often as it likes."""
    width, height = options.size.split("x")
    sequence = options.work / f"loop_{options.rendered}_{options.size}"
    rooms = [sequence / f"room_{seed}" for seed in (3, 4)[: 2 if options.cuts else 1]]
    for room in rooms:
        if not (room / "camera.txt").exists():
            subprocess.run([options.bin / "dso_synthesize", "room", "--output", room, "--seed", room.name[-1], "--quiet",
                            "--frames", str(options.rendered), "--width", width, "--height", height], check=True)
    (sequence / "camera.txt").write_text((rooms[0] / "camera.txt").read_text())
    with (sequence / "rgb.txt").open("w") as table:
        for i in range(options.frames):
            room = rooms[i // options.cuts % 2] if options.cuts else rooms[0]
            there = i % (2 * options.rendered - 2)
            image = min(there, 2 * options.rendered - 2 - there)
            table.write(f"{i / 30:.6f} {room.name}/images/{image:05d}.png\n")
    return sequence


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--work", type=pathlib.Path, required=True, help="folder for the sequence and the output")
    parser.add_argument("--frames", type=int, default=3000)
    parser.add_argument("--early", type=int, default=600, help="frame to compare with")
    parser.add_argument("--rendered", type=int, default=600, help="frames of a room")
    parser.add_argument("--cuts", type=int, default=0, metavar="N", help="frames from one jump to the next")
    parser.add_argument("--size", default="240x180")
    parser.add_argument("--limit", type=float, default=2, help="largest growth [%%]")
    parser.add_argument("extra", nargs="*", help="further arguments of dso_dataset")
    options = parser.parse_args()

    sequence = long_sequence(options)
    output = options.work / "out"
    (output / "frames.csv").unlink(missing_ok=True)
    process = subprocess.Popen([options.bin / "dso_dataset", sequence, "--output", output, "--quiet", *options.extra])
    samples = watch(process, output / "frames.csv")
    if process.returncode != 0:
        sys.exit(f"dso_dataset ended with {process.returncode}")
    if not samples or samples[-1][0] < options.frames - SPAN:
        sys.exit("dso_dataset ended before the last frame")

    def around(frame):
        return statistics.median(memory for done, memory in samples if abs(done - frame) <= SPAN / 2)

    early, late = around(options.early), around(options.frames - SPAN / 2)
    growth = 100 * ((late - POSE * (options.frames - options.early)) / early - 1)
    for frame in range(options.early, options.frames, options.early):
        print(f"frame {frame}: {around(frame):.1f} MiB")
    print(f"end: {late:.1f} MiB, {growth:+.2f} % since frame {options.early} beside the poses (limit {options.limit} %)")
    sys.exit(0 if growth <= options.limit else 1)


if __name__ == "__main__":
    main()
