# SPDX-License-Identifier: BSD-3-Clause
"""One run of the program, kept whatever becomes of it.

A run's folder holds `record.json` once it ended (command, exit code, wall time), `out/` (what the program wrote) and
`log.txt`. The record is written last and by rename: a folder without one is a run that was interrupted, and is begun anew."""
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from .protocol import dump_json, write_if_changed

TIMED_OUT = 124  # exit code, as of timeout(1)
RECORD = 'record.json'
FIGURES = 'figures.json'


class Interrupted(Exception):
    """The run did not come to its own end; nothing is recorded."""


def stop(process):
    """Ends the program and whatever it started."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()


def execute(command, log, timeout):
    """Runs a command in a session of its own: a Ctrl-C meant for the evaluation must not end it as a normal end.

    @return exit code (negative: signal), wall seconds"""
    began = time.monotonic()
    with open(log, 'wb') as stream:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream, start_new_session=True)
        try:
            code = process.wait(timeout)
        except subprocess.TimeoutExpired:
            code = TIMED_OUT
        finally:
            if process.poll() is None:
                stop(process)
    return code, time.monotonic() - began


def interrupted_by_itself(out):
    """Whether the program says that somebody stopped it."""
    try:
        return json.loads((out / 'run.json').read_text()).get('status') == 'interrupted'
    except (OSError, ValueError, AttributeError):
        return False


def run_one(run, folder, timeout):
    """Runs it and writes the record. A failing program is a result; only an interrupted one is none.

    @param run     entry of plan()['runs']
    @param folder  its folder; whatever an interrupted attempt left there is removed
    @throws Interrupted, OSError"""
    folder = Path(folder)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    attempt = Path(tempfile.mkdtemp(prefix='attempt_', dir=folder))  # an orphan of a killed attempt writes elsewhere
    code, seconds = execute(run['command'] + ['--output', str(attempt)], folder / 'log.txt', timeout)
    if interrupted_by_itself(attempt):
        raise Interrupted(f"{run['key']}: interrupted")
    attempt.chmod(0o755)  # mkdtemp makes it private
    attempt.rename(folder / 'out')
    record = dict(key=run['key'], command=run['command'], exit_code=code, wall_seconds=round(seconds, 3))
    write_if_changed(folder / RECORD, dump_json(record))
    return record


def read_record(folder):
    """The record of a run that ended, else None."""
    try:
        return json.loads((Path(folder) / RECORD).read_text())
    except (OSError, ValueError):
        return None


def on_terminate(*_):
    raise Interrupted('terminated')


def install_terminate_handler():
    """SIGTERM (of a scheduler, or of evaluate.py) unwinds, so that the program is ended too."""
    signal.signal(signal.SIGTERM, on_terminate)
