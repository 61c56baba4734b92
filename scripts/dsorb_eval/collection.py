# SPDX-License-Identifier: BSD-3-Clause
"""`dsorb run` over a list of videos, and one table of what each of them gave.

A video's folder holds `record.json` once its run ended, `out/` and `log.txt`; a folder without a record is one of a run
that was interrupted, and is begun anew."""
from __future__ import annotations

import csv
import hashlib
import json
import re
import resource
import shlex
import shutil
import statistics
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Optional

from . import runner
from .protocol import dump_json, write_if_changed
from .trajectory import FormatError

LOG_BYTES = 4000  # of a log's end that are looked at for the reason of a failure
ADVICE = re.compile(r'What (stood in the way|\d+ of the images without a pose show):')  # of the summary: dsorb/summary.py
# Columns of the table with their types for Parquet.
COLUMNS = {'video': 'string', 'name': 'string', 'status': 'string', 'exit_code': 'int32', 'error': 'string',
           'obstacle': 'string', 'suspected': 'string', 'images': 'int32', 'images_posed': 'int32', 'share_posed': 'float64',
           'wrong_probability': 'float64', 'segments': 'int32', 'losses': 'int32', 'refined_focal_px': 'float64',
           'refined_focal_sigma_px': 'float64', 'readout_ms': 'float64', 'readout_sigma_ms': 'float64', 'ms_per_image': 'float64',
           'wall_seconds': 'float64', 'processor_seconds': 'float64'}


def name_of(words: list[str]) -> str:
    """Folder of a video: readable, and another one for other arguments."""
    stem = re.sub(r'[^\w.+-]', '_', Path(words[0]).stem)[:60]
    return f'{stem}-{hashlib.sha256(shlex.join(words).encode()).hexdigest()[:8]}'


def read_list(path: str) -> dict[str, list[str]]:
    """Video and arguments of its own by the name of its folder. Lines are those of a shell: `clip.mp4 --hfov 65`; paths of
    videos are relative to the list's folder. Raises FormatError."""
    videos = {}
    for number, line in enumerate(Path(path).read_text(encoding='utf-8').splitlines(), 1):
        try:
            words = shlex.split(line, comments=True)
        except ValueError as error:
            raise FormatError(f'{path}:{number}: {error}') from None
        if words:
            words[0] = words[0] if '://' in words[0] else str(Path(path).resolve().parent / words[0])
            videos[name_of(words)] = words
    if not videos:
        raise FormatError(f'{path}: names no video')
    return videos


def processor_seconds() -> float:
    """Seconds that all programs took which this one ran."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return round(used.ru_utime + used.ru_stime, 3)


def run(list_file: str, name: str, record_file: str, timeout: int, command: str, arguments: str) -> None:
    """One video. A failing program is a result; raises Interrupted where somebody stopped it."""
    folder = Path(record_file).parent.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    (folder / 'out').mkdir(parents=True)  # the workflow expects it, also of a program that does not come to make it
    video, *own = read_list(list_file)[name]
    words = [*shlex.split(command), video, *shlex.split(arguments), *own, '--output', str(folder / 'out')]
    code, seconds = runner.execute(words, folder / 'log.txt', timeout)
    if runner.interrupted_by_itself(folder / 'out'):
        raise runner.Interrupted(f'{name}: interrupted')
    write_if_changed(Path(record_file), dump_json(dict(name=name, command=words, exit_code=code, wall_seconds=round(seconds, 3),
                                                        processor_seconds=processor_seconds())))


def log_lines(folder: Path) -> list[str]:
    """The last lines of a log, without those that are empty."""
    text = (folder / 'log.txt').read_bytes()[-LOG_BYTES:].decode('utf-8', 'replace')
    return [line.strip() for line in re.split(r'[\r\n]+', text) if line.strip()]


def obstacle_of(folder: Path) -> Optional[str]:
    """The first reason of the summary why images have no pose, without its figures: `too dark`, `too_little_parallax`."""
    lines = log_lines(folder)
    for line, following in zip(lines, lines[1:]):
        if ADVICE.match(line):
            return re.sub(r'^\d+ x ', '', following).partition(':')[0]
    return None


def suspected_of(folder: Path) -> Optional[str]:
    """What the summary suspects of the camera: `calibration`, `rolling shutter`."""
    found = [line.partition(' suspected: ')[0] for line in log_lines(folder) if ' suspected: ' in line]
    return ', '.join(found) or None


def why(folder: Path) -> str:
    """The line of the log that says what went wrong."""
    lines = log_lines(folder)
    return next((line for line in reversed(lines) if 'error' in line.lower() or line.startswith('dsorb:')), lines[-1] if lines else '')


def loaded(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return {}


def rows_of(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(newline='', encoding='utf-8') as file:
            return list(csv.DictReader(file))
    except (OSError, csv.Error):
        return []


def count_lines(path: Path) -> int:
    try:
        return sum(1 for line in path.read_text(encoding='utf-8').splitlines() if line and not line.startswith('#'))
    except OSError:
        return 0


def posed(out: Path) -> int:
    """Images with a pose, of all segments."""
    several = [file for file in out.glob('trajectory_*.txt') if file.stem.rpartition('_')[2].isdigit()]
    return sum(map(count_lines, several)) if several else count_lines(out / 'trajectory.txt')


def row_of(video: str, folder: Path) -> dict[str, Any]:
    """What a video gave; None where nothing is known."""
    record, out = loaded(folder / runner.RECORD), folder / 'out'
    summary, frames = loaded(out / 'run.json'), rows_of(out / 'frames.csv')
    starts = [start for start in loaded(out / 'initialization.json').get('initializations', []) if not start['refused']]
    wrong = [start['report'].get('wrong_probability') for start in starts]
    refined, readout = (summary.get(key) or {} for key in ('refined_camera', 'readout'))
    times = [float(row['milliseconds']) for row in frames]
    images_posed = posed(out)
    failed = record['exit_code'] not in (0, 3)
    status = 'timeout' if record['exit_code'] == runner.TIMED_OUT else 'error' if failed else summary.get('status', 'error')
    return dict(video=video, name=folder.name, status=status, exit_code=record['exit_code'], error=why(folder) if failed else None,
                obstacle=None if failed else obstacle_of(folder),
                suspected=suspected_of(folder), images=len(frames), images_posed=images_posed,
                share_posed=round(images_posed / len(frames), 4) if frames else None,
                wrong_probability=max((float(f'{w:.3g}') for w in wrong if w is not None), default=None), segments=summary.get('segments'),
                losses=sum(row['state'] == 'lost' for row in frames), refined_focal_px=refined.get('fx'),
                refined_focal_sigma_px=refined.get('sigma', {}).get('fx'),
                readout_ms=readout.get('milliseconds'), readout_sigma_ms=readout.get('sigma'),
                ms_per_image=round(statistics.fmean(times), 3) if times else None,
                wall_seconds=record['wall_seconds'], processor_seconds=record.get('processor_seconds'))


def write_parquet(rows: list[dict[str, Any]], path: Path) -> bool:
    """@return whether pyarrow is there to do it"""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return False
    schema = pyarrow.schema([(name, getattr(pyarrow, kind)()) for name, kind in COLUMNS.items()])
    parquet.write_table(pyarrow.Table.from_pylist(rows, schema), path)
    return True


def conclusion(rows: Iterable[dict[str, Any]]) -> str:
    """The closing line, for people."""
    rows = list(rows)
    failed = sum(row['error'] is not None for row in rows)
    share = statistics.median(row['share_posed'] or 0 for row in rows)
    hours = sum(row['processor_seconds'] or 0 for row in rows) / 3600
    cost = f'; {len(rows) / hours:.0f} videos an hour of processor time' if hours else ''
    return f'{len(rows)} videos, {failed} failed; {100 * share:.0f} % posed in the median{cost}'


def write_table(list_file: str, table: str) -> Optional[str]:
    """table.csv, and table.parquet where pyarrow is there. @return the closing line"""
    target = Path(table)
    rows = [row_of(words[0], target.parent / 'videos' / name) for name, words in read_list(list_file).items()]
    with target.open('w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    if not write_parquet(rows, target.with_suffix('.parquet')):
        print('no table.parquet: the package pyarrow is not installed')
    return conclusion(rows)
