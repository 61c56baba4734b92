# SPDX-License-Identifier: BSD-3-Clause
"""What is to be run: sequences, start frames, and the list of runs with their commands and folders.

A run's folder is named by a hash over everything that decides its result: the program (with its own shared
libraries), the effective configuration, the data set's path and image times, threads and further arguments. Results of two builds or two
configurations therefore never meet in one folder, and what is there already need not be run again."""
import hashlib
import json
import re
import shlex
import subprocess
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

from . import layout
from .trajectory import FormatError

# Initializers; behind a plus sign the preset that goes with one, else the default.
VARIANTS = ('coarse', 'coarse+reference', 'orb-v1', 'orb-v2', 'orb-v3', 'orb-matching', 'orb')
FIVE_STARTS = range(0, 50, 10)  # five forward and five backward runs, as in [Gladkova], section 4
MIN_FRAMES = 20  # a run over fewer frames says nothing
HASH_LENGTH = 12
SEQUENCE_KEYS = {'name', 'path', 'format', 'groundtruth', 'first', 'last', 'no_start', 'dataset'}


@dataclass(frozen=True)
class Sequence:
    name: str
    path: str
    format: str
    groundtruth: str  # '' where there is none
    first: int
    last: int  # included
    no_start: bool = False  # nothing to triangulate: kept out of the totals
    dataset: str = ''  # sequences of one data set share a table; '' : by the name's first part


def fail(file, position, message):
    raise FormatError(f'{file}: sequence {position}: {message}')


def read_sequence(file, position, entry):
    """One entry of the sequences file, checked; paths are relative to that file."""
    if not isinstance(entry, dict) or not {'name', 'path'} <= set(entry):
        fail(file, position, 'expected at least `name` and `path`')
    unknown = set(entry) - SEQUENCE_KEYS
    if unknown:
        fail(file, position, f'unknown key {sorted(unknown)[0]!r}; known: {", ".join(sorted(SEQUENCE_KEYS))}')
    name, kind = str(entry['name']), entry.get('format', 'auto')
    if not re.fullmatch(r'[\w.+-]+', name) or name == 'TOTAL':
        fail(file, position, f'name {name!r} must be letters, digits, `_ . + -`, and not TOTAL')
    dataset = str(entry.get('dataset') or name.split('_')[0])
    if not re.fullmatch(r'[\w.+-]+', dataset) or dataset == 'all':
        fail(file, position, f'dataset {dataset!r} must be letters, digits, `_ . + -`, and not all')
    if kind not in layout.FORMATS:
        fail(file, position, f'format {kind!r} is none of {", ".join(layout.FORMATS)}')
    path = (file.parent / str(entry['path'])).resolve()
    count = len(layout.timestamps(path, kind))
    first, last = entry.get('first', 0), entry.get('last', count - 1)
    if not (isinstance(first, int) and isinstance(last, int) and 0 <= first <= last < count):
        fail(file, position, f'first {first}, last {last}: expected 0 <= first <= last <= {count - 1}')
    truth = (file.parent / str(entry['groundtruth'])).resolve() if 'groundtruth' in entry else \
        layout.default_ground_truth(path, kind)
    if truth is not None and not truth.exists():
        fail(file, position, f'groundtruth {truth}: no such file')
    layout.load_ground_truth(truth, path, kind)  # whatever is wrong with it is said now, not after hours of runs
    return Sequence(name, str(path), kind, str(truth or ''), first, last, bool(entry.get('no_start', False)), dataset)


def read_sequences(path):
    """Sequences of a YAML file `sequences: [{name, path, format, groundtruth, first, last}, ...]`.

    @throws FormatError naming file, entry and what was expected"""
    file = Path(path).resolve()
    try:
        content = yaml.safe_load(file.read_text())
    except yaml.YAMLError as error:
        raise FormatError(f'{file}: {error}') from None
    entries = content.get('sequences') if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise FormatError(f'{file}: expected `sequences:` with a list of {{name, path, ...}}')
    sequences = [read_sequence(file, position, entry) for position, entry in enumerate(entries, 1)]
    names = [sequence.name for sequence in sequences]
    if len(set(names)) < len(names):
        raise FormatError(f'{file}: two sequences are called {next(n for n in names if names.count(n) > 1)!r}')
    return sequences


def start_offsets(starts, length):
    """Offsets of the start frames: `five` or `every:K`. @throws FormatError"""
    if starts == 'five':
        return list(FIVE_STARTS)
    match = re.fullmatch(r'every:([1-9]\d*)', starts)
    if not match:
        raise FormatError(f'--starts {starts}: expected five or every:K')
    return list(range(0, length, int(match[1])))


def ranges_of(sequence, starts, frames):
    """(start, end, reverse) of all runs over a sequence: the images [start, end), reversed from end - 1 down."""
    length = sequence.last + 1 - sequence.first
    for offset in start_offsets(starts, length):
        if length - offset < MIN_FRAMES:
            continue
        yield sequence.first + offset, sequence.first + min(length, offset + frames), False
        end = sequence.last + 1 - offset
        yield max(sequence.first, end - frames), end, True


def sha256(*parts):
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else str(part).encode()
        digest.update(len(data).to_bytes(8, 'little') + data)
    return digest.hexdigest()


def hash_program(program):
    """Hash of the program and of the shared libraries of its own that it loads (ldd, where there is one)."""
    parts = [Path(program).read_bytes()]
    try:
        listing = subprocess.run(['ldd', str(program)], capture_output=True, text=True, timeout=60).stdout
    except (OSError, subprocess.TimeoutExpired):
        listing = ''
    for match in sorted(re.findall(r'libdsorb\S* => (\S+)', listing)):
        parts.append(Path(match).read_bytes())
    return sha256(*parts)


def arguments_of(variant):
    """The program's arguments for a variant."""
    initializer, _, preset = variant.partition('+')
    return ['--initializer', initializer, *(['--preset', preset] if preset else [])]


def effective_config(program, variant, extra):
    """Text of the configuration a run with these arguments has. @throws FormatError with the program's own words"""
    command = [str(program), *arguments_of(variant), *extra, '--print-config']
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if answer.returncode:
        raise FormatError(f'{shlex.join(command)}: exit {answer.returncode}: {(answer.stderr or answer.stdout).strip()[-500:]}')
    return answer.stdout


@dataclass
class Request:
    """What evaluate.py was asked for."""
    program: str
    sequences: str
    variants: list
    starts: str
    frames: int
    threads: int = 1
    extra: tuple = ()
    timeout: int = 3600
    evo: bool = True


def plan(request):
    """The evaluation as plain data, written to plan.json: everything a run, a judge or a report needs to know.

    Runs are in the order sequence, variant, start, direction; each has a `key` that is also its folder's name."""
    program = str(Path(request.program).resolve())
    build = hash_program(program)
    sequences = read_sequences(request.sequences)
    configs = {v: effective_config(program, v, list(request.extra)) for v in request.variants}
    runs = []
    for sequence in sequences:
        # the data set's state at a glance: another excerpt under the same path is another run
        times = layout.timestamps(Path(sequence.path), sequence.format)
        for variant in request.variants:
            identity = sha256(build, configs[variant], json.dumps(times))
            runs += [make_run(request, identity, sequence, variant, span)
                     for span in ranges_of(sequence, request.starts, request.frames)]
    return dict(version=1, scripts=str(Path(__file__).resolve().parent.parent), program=program, build=build, starts=request.starts, frames=request.frames, threads=request.threads,
                extra=list(request.extra), timeout=request.timeout, evo=request.evo, variants=list(request.variants),
                configs=configs, sequences=[asdict(s) for s in sequences], runs=runs)


def make_run(request, identity, sequence, variant, span):
    """One run of the plan; `key` names its folder."""
    start, end, reverse = span
    program = str(Path(request.program).resolve())
    command = [program, sequence.path, '--format', sequence.format, *arguments_of(variant), '--start', str(start), '--end', str(end),
               '--threads', str(request.threads), '--quiet', *(['--reverse'] if reverse else []), *request.extra]
    key = sha256(identity, json.dumps(command[1:]), sequence.groundtruth, request.timeout)[:HASH_LENGTH]
    name = f"{'bwd' if reverse else 'fwd'}_{start:05d}_{end:05d}"
    return dict(key=f'{sequence.name}/{variant}/{name}_{key}', sequence=sequence.name, variant=variant, start=start, end=end,
                reverse=reverse, command=command)


def write_if_changed(path, text):
    """Writes a file only where its content differs, by rename."""
    path = Path(path)
    if path.exists() and path.read_text() == text:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + '.tmp')
    temporary.write_text(text)
    temporary.replace(path)


def dump_json(value):
    return json.dumps(value, indent=1, sort_keys=True, allow_nan=False) + '\n'
