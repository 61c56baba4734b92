# SPDX-License-Identifier: BSD-3-Clause
"""evo (https://github.com/MichaelGrupp/evo), called as separate programs and never imported: it is GPL.

It aligns, and computes ATE and RPE, a second time; its numbers stand beside ours and must agree."""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from . import trajectory as tr

TIMEOUT = 300  # [s]


def program(name):
    """Path of one of evo's programs: beside this Python first, then on PATH; None where there is none."""
    beside = Path(sys.executable).parent / name
    return str(beside) if beside.exists() else shutil.which(name)


def available():
    return all(program(name) for name in ('evo_ape', 'evo_rpe', 'evo_traj'))


def call(arguments, folder):
    """Runs one of evo's programs in a folder of its own. @throws RuntimeError with its last words"""
    environment = dict(os.environ, MPLBACKEND='Agg', HOME=str(folder))  # it writes settings to the home folder
    answer = subprocess.run(arguments, capture_output=True, text=True, timeout=TIMEOUT, cwd=folder, env=environment)
    if answer.returncode:
        raise RuntimeError(f'{Path(arguments[0]).name}: exit {answer.returncode}: {(answer.stderr or answer.stdout).strip()[-300:]}')


def rmse(name, true_file, estimate_file, folder, *options):
    """Root mean square error that evo_ape or evo_rpe finds after Sim(3) alignment."""
    results = Path(folder) / f'{name}.zip'
    call([program(name), 'tum', str(true_file), str(estimate_file), '--align', '--correct_scale', '--no_warnings',
          '--save_results', str(results), *options], folder)
    with zipfile.ZipFile(results) as archive:
        return float(json.loads(archive.read('stats.json'))['rmse'])


def trajectory_errors(rows, truth):
    """ATE and RPE (step 1, translation) by evo, with the truth at the very times of the trajectory.

    @return dict(ate, rpe), or dict(error) with evo's words where it refuses"""
    estimate, true = truth.matched(rows)
    with tempfile.TemporaryDirectory(prefix='dsorb_evo_') as folder:
        files = [Path(folder) / 'truth.txt', Path(folder) / 'estimate.txt']
        for file, poses in zip(files, (true, estimate)):
            tr.save_tum(file, poses)
        try:
            return dict(ate=rmse('evo_ape', *files, folder),
                        rpe=rmse('evo_rpe', *files, folder, '--delta', '1', '--delta_unit', 'f'))
        except (RuntimeError, OSError, ValueError, subprocess.TimeoutExpired) as error:
            return dict(error=str(error))


def trajectory_plot(true_rows, estimates, target):
    """evo_traj's plot of trajectories against the truth, each aligned to it, as PNG.

    @param estimates  list of (label, rows)
    @return the files it wrote: its trajectories, rotations, ... as target_<kind>.png"""
    target = Path(target)
    with tempfile.TemporaryDirectory(prefix='dsorb_evo_') as folder:
        tr.save_tum(Path(folder) / 'truth.txt', true_rows)
        for label, rows in estimates:
            tr.save_tum(Path(folder) / f'{label}.txt', rows)
        call([program('evo_traj'), 'tum', *(f'{label}.txt' for label, _ in estimates), '--ref', 'truth.txt', '--align',
              '--correct_scale', '--no_warnings', '--plot_mode', 'xz', '--save_plot', str(target)], folder)
    return sorted(target.parent.glob(f'{target.stem}*{target.suffix}'))
