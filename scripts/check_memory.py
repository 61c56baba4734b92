#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Does the memory of dso_dataset grow with the length of the sequence? Renders a long synthetic one (once), runs on it
and compares resident memory at an early frame with that at the end.

    scripts/check_memory.py --bin build/bin --work /tmp/memory [--frames 3000 --early 600 --size 240x180] [-- extra]
"""
import argparse
import pathlib
import statistics
import subprocess
import sys
import time

SPAN = 100  # frames over which the median is taken: memory goes up and down with every keyframe


def resident_mb(pid):
    for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return None  # the process has just ended


def watch(process, table):
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
        time.sleep(0.02)
    return samples


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--work", type=pathlib.Path, required=True, help="folder for the sequence and the output")
    parser.add_argument("--frames", type=int, default=3000)
    parser.add_argument("--early", type=int, default=600, help="frame to compare with")
    parser.add_argument("--size", default="240x180")
    parser.add_argument("--limit", type=float, default=2, help="largest growth [%%]")
    parser.add_argument("extra", nargs="*", help="further arguments of dso_dataset")
    options = parser.parse_args()

    width, height = options.size.split("x")
    sequence = options.work / f"room_{options.frames}_{options.size}"
    if not (sequence / "camera.txt").exists():
        subprocess.run([options.bin / "dso_synthesize", "room", "--output", sequence, "--frames", str(options.frames),
                        "--width", width, "--height", height, "--quiet"], check=True)
    output = options.work / "out"
    (output / "frames.csv").unlink(missing_ok=True)
    process = subprocess.Popen([options.bin / "dso_dataset", sequence, "--output", output, "--quiet", *options.extra])
    samples = watch(process, output / "frames.csv")
    if process.returncode != 0:
        sys.exit(f"dso_dataset ended with {process.returncode}")

    def around(frame):
        return statistics.median(memory for done, memory in samples if abs(done - frame) <= SPAN / 2)

    early, late = around(options.early), around(options.frames - SPAN / 2)
    growth = 100 * (late / early - 1)
    for frame in range(options.early, options.frames, options.early):
        print(f"frame {frame}: {around(frame):.1f} MiB")
    print(f"end: {late:.1f} MiB, {growth:+.2f} % since frame {options.early} (limit {options.limit} %)")
    sys.exit(0 if growth <= options.limit else 1)


if __name__ == "__main__":
    main()
