# SPDX-License-Identifier: BSD-3-Clause
"""What scripts/evaluate.py does: plan, hand the runs to Snakemake, show progress, say where the results are."""
import argparse
import contextlib
import fcntl
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml

from . import evo, no_calibration, protocol
from .runner import FIGURES, RECORD, read_record
from .trajectory import FormatError

SCRIPTS = Path(__file__).resolve().parent.parent
POLL = .2  # [s] between looks at the runs' folders
LOG_TAIL = 25  # lines of Snakemake's log that an error shows
REQUESTS, PATIENCE = 10, 1.  # requests to end, [s] between them


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(prog='evaluate.py', description='Runs dso_dataset over sequences from many start frames, '
                                     'forward and reversed, and measures it against ground truth.')
    parser.add_argument('--bin', required=True, metavar='PATH', help='the dso_dataset program')
    parser.add_argument('--sequences', required=True, metavar='FILE.yaml', help='`sequences:` a list of {name, path, format, '
                        'groundtruth, first, last}; the last four may be left out')
    parser.add_argument('--variants', nargs='+', default=list(protocol.VARIANTS), metavar='NAME',
                        help='initializers, with +PRESET where it is not the default; default: all, and coarse+reference')
    parser.add_argument('--starts', default='five', help='five (0, 10, .. 40, as in [Gladkova]) or every:K; default five')
    parser.add_argument('--frames', type=int, default=200, metavar='N', help='frames given to a run at most; default 200')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='runs side by side; 1 (default) when times matter')
    parser.add_argument('--output', required=True, metavar='DIR', help='results; runs that are there already are not repeated')
    parser.add_argument('--threads', type=int, default=1, metavar='N', help='threads of each run; default 1')
    parser.add_argument('--extra', default='', metavar='ARGS', help='more arguments for the program, one string')
    parser.add_argument('--timeout', type=int, default=3600, metavar='S', help='seconds after which a run counts as failed; default 3600')
    parser.add_argument('--retry-failed', action='store_true', help='repeat runs that failed before')
    parser.add_argument('--no-evo', action='store_true', help='do not let evo compute ATE and RPE a second time')
    parser.add_argument('--report-only', action='store_true', help='run nothing; report on what is there')
    parser.add_argument('--profile', metavar='DIR', help='Snakemake profile, for a cluster: scripts/profiles has examples')
    parser.add_argument('--dry-run', action='store_true', help='say what would run, and stop')
    parser.add_argument('--no-calibration', action='store_true', help='instead: whole sequences without their calibration, as files and as '
                        'H.264 videos, beside the run with it; no_calibration.md')
    parser.add_argument('--quiet', action='store_true', help='no progress bar')
    return parser.parse_args(arguments)


def request_of(args):
    """What was asked for, checked as far as possible before anything runs. @throws FormatError"""
    if not os.access(args.bin, os.X_OK) or not Path(args.bin).is_file():
        raise FormatError(f'--bin {args.bin}: no such program')
    if args.frames < protocol.MIN_FRAMES:
        raise FormatError(f'--frames {args.frames}: expected at least {protocol.MIN_FRAMES}')
    if args.jobs < 1 or args.threads < 0 or args.timeout < 1:
        raise FormatError('--jobs and --timeout: expected at least 1; --threads: at least 0')
    if len(set(args.variants)) < len(args.variants):
        raise FormatError('--variants: one is named twice')
    if not args.no_evo and not evo.available():
        raise FormatError('evo_ape, evo_rpe or evo_traj is missing: run scripts/venv.sh, or use --no-evo')
    return protocol.Request(args.bin, args.sequences, args.variants, args.starts, args.frames, args.threads,
                            tuple(shlex.split(args.extra)), args.timeout, not args.no_evo)


def lock(folder):
    """Only one evaluation works in a folder; the lock ends with the process. @throws FormatError"""
    folder.mkdir(parents=True, exist_ok=True)
    stream = open(folder / '.lock', 'w')
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise FormatError(f'{folder}: another evaluation is at work there') from None
    return stream


def forget_failed(plan, folder):
    """Removes the records of failed runs, so that they are done again. @return their number"""
    count = 0
    for run in plan['runs']:
        path = folder / 'runs' / run['key']
        if read_record(path) and (path / FIGURES).exists() and json.loads((path / FIGURES).read_text())['crashed']:
            (path / RECORD).unlink()
            count += 1
    return count


def snakemake_command(args, folder):
    """Snakemake's command line. The folder's own lock is ours, hence --nolock; a run is complete when its record is
    there, even if Snakemake was ended before it had noticed, hence --ignore-incomplete; the report is cheap and follows the
    code that writes it, hence --forcerun."""
    command = [sys.executable, '-m', 'snakemake', '--snakefile', str(SCRIPTS / 'Snakefile'), '--directory', str(folder), '--nolock',
               '--rerun-triggers', 'mtime', '--ignore-incomplete', '--keep-going', '--forcerun', 'report', '--workflow-profile', 'none',
               '--scheduler', 'greedy']  # all runs are alike: nothing to optimise
    command += ['--dry-run'] if args.dry_run else []
    if not args.profile:
        return command + ['--cores', str(args.jobs)]
    profile = Path(args.profile).resolve()
    command += ['--profile', str(profile), '--jobs', str(args.jobs), '--config', f'folder={folder}']
    if 'default-storage-provider' in profile_of(profile):  # jobs work on copies of what lies in the output folder
        command += ['--default-storage-prefix', str(folder)]
    return command


def profile_of(folder):
    """Content of a Snakemake profile. @throws FormatError"""
    path = folder / 'config.yaml'
    if not path.exists():
        raise FormatError(f'--profile {folder}: no config.yaml there')
    return yaml.safe_load(path.read_text()) or {}


def count_done(plan, folder):
    return sum((folder / 'runs' / run['key'] / RECORD).exists() for run in plan['runs'])


def watch(process, plan, folder, quiet):
    """Progress bar over finished runs until Snakemake ends; a Ctrl-C or SIGTERM ends it, and all runs, first."""
    from tqdm import tqdm
    with tqdm(total=len(plan['runs']), initial=count_done(plan, folder), unit='run', disable=True if quiet else None) as bar:
        try:
            while process.poll() is None:
                time.sleep(POLL)
                bar.update(count_done(plan, folder) - bar.n)
            bar.update(count_done(plan, folder) - bar.n)
        except BaseException:
            end(process)
            raise


def end(process):
    """Ends Snakemake and its jobs: the runners get SIGTERM and end their programs.

    Asked again for jobs that were just beginning. Killed in the end: Snakemake's handler of SIGTERM takes a lock, and waits
    for ever where it interrupted the thread that holds it."""
    for request in [signal.SIGTERM] * REQUESTS + [signal.SIGKILL]:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, request)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
            return
    process.wait()


def run_workflow(args, plan, folder):
    """Hands the plan to Snakemake. @return its exit code"""
    log = folder / 'log' / 'snakemake.log'
    log.parent.mkdir(exist_ok=True)
    with open(log, 'w') as stream:
        environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(SCRIPTS), os.environ.get('PYTHONPATH', '')]).rstrip(os.pathsep))
        process = subprocess.Popen(snakemake_command(args, folder), stdin=subprocess.DEVNULL, stdout=stream, stderr=stream,
                                   env=environment, start_new_session=True)
        watch(process, plan, folder, args.quiet)
    if process.returncode or args.dry_run:
        print(''.join(log.read_text().splitlines(keepends=True)[-LOG_TAIL:]), end='', file=sys.stderr)
    return process.returncode


def evaluate(args):
    """@return exit code: 0 all runs done (failed ones are results), 1 some could not be done"""
    request = request_of(args)
    plan, folder = protocol.plan(request), Path(args.output).resolve()
    with lock(folder):
        protocol.write_if_changed(folder / 'plan.json', protocol.dump_json(plan))
        if args.retry_failed:
            print(f'{forget_failed(plan, folder)} failed runs will be repeated', file=sys.stderr)
        code = 0
        if not args.report_only:
            code = run_workflow(args, plan, folder)
            if args.dry_run:
                return code
        if args.report_only or code:
            from . import report  # after all runs the workflow itself has written it
            report.write(folder)
        return finish(plan, folder, code)


def finish(plan, folder, code):
    """The closing lines, for people."""
    missing = len(plan['runs']) - count_done(plan, folder)
    failed = (folder / 'failed.txt').read_text().splitlines()
    print(f'{len(plan["runs"]) - missing} runs, {len(failed)} failed; report: {folder / "report.html"}')
    for line in failed:
        print('failed, exit ' + line.replace('\t', ': ', 1), file=sys.stderr)
    if missing:
        print(f'{missing} runs were not done; the same command goes on with them (log: {folder / "log/snakemake.log"})', file=sys.stderr)
    return 1 if code or missing else 0


def raise_interrupt(*_):
    raise KeyboardInterrupt


def main(arguments=None):
    signal.signal(signal.SIGTERM, raise_interrupt)
    try:
        args = parse_arguments(arguments)
        return no_calibration.evaluate(args) if args.no_calibration else evaluate(args)
    except FormatError as error:
        print(f'evaluate.py: {error}', file=sys.stderr)
        return 2
    except OSError as error:
        print(f'evaluate.py: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('\ninterrupted; the same command goes on where this one stopped', file=sys.stderr)
        return 130
