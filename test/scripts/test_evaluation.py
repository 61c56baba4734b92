# SPDX-License-Identifier: BSD-3-Clause
"""scripts/evaluate.py end to end on synthetic sequences, interrupted and resumed, with a run that fails.

DSO_DATASET and DSO_SYNTHESIZE name the programs (ctest sets them); without them the tests are skipped."""
import contextlib
import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock
from pathlib import Path

from dsorb_eval import cli, package

SCRIPTS = Path(__file__).resolve().parents[2] / 'scripts'
PATIENCE = 120  # [s] until a step of the evaluation must have happened, also on a busy machine
# The program, slow enough to be interrupted, and failing from one start frame.
WRAPPER = """#!/bin/sh
case "$*" in *--print-config*) exec {program} "$@";; esac
case "$*" in *"--start 10 "*) echo "pretended failure" >&2; exit 1;; esac
sleep {pause}
exec {program} "$@"
"""


def setUpModule():
    for name in ('DSO_DATASET', 'DSO_SYNTHESIZE'):
        if not os.path.exists(os.environ.get(name, '')):
            raise unittest.SkipTest(f'{name} names no program')


class Evaluation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(tempfile.mkdtemp(prefix='dsorb_evaluation_'))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        for kind, frames in (('room', 30), ('static', 24)):
            subprocess.run([os.environ['DSO_SYNTHESIZE'], kind, '-o', cls.folder / kind, '--frames', str(frames), '--width', '320',
                            '--height', '240', '--threads', '1', '--quiet'], check=True)
        (cls.folder / 'bin').mkdir()
        (cls.folder / 'python').symlink_to(Path(os.environ['DSO_DATASET']).parent.parent / 'python')
        (cls.folder / 'sequences.yaml').write_text('sequences:\n- {name: room, path: room}\n'
                                                   '- {name: static, path: static, no_start: true}\n')

    def command(self, program, output, *more):
        return [sys.executable, str(SCRIPTS / 'evaluate.py'), '--bin', str(program), '--sequences', str(self.folder / 'sequences.yaml'),
                '--variants', 'orb', '--starts', 'every:10', '--frames', '24', '--output', str(self.folder / output), '--quiet', *more]

    def environment(self):
        return dict(os.environ, DSORB_VENV=sys.prefix, PYTHONWARNINGS='default')

    def evaluate(self, program, output, *more):
        return subprocess.run(self.command(program, output, *more), capture_output=True, text=True, env=self.environment())

    def wrapper(self, name, pause):
        path = self.folder / 'bin' / name
        path.write_text(WRAPPER.format(program=os.environ['DSO_DATASET'], pause=pause))
        path.chmod(0o755)
        return path

    def records(self, output):
        return sorted((self.folder / output / 'runs').glob('*/*/*/record.json'))

    def processes_of(self, program):
        """Command lines of processes that run this program or the evaluation of it."""
        found, mine = [], str(self.folder / 'bin' / program).encode()
        for file in Path('/proc').glob('[0-9]*/cmdline'):
            with contextlib.suppress(OSError):
                words = file.read_bytes()
                found += [words] if mine in words or str(self.folder / 'out').encode() in words else []
        return found

    def rows(self, output):
        with open(self.folder / output / 'summary.csv', newline='') as file:
            return {(row['sequence'], row['variant']): row for row in csv.DictReader(file)}

    def wait_for(self, condition, what):
        limit = time.monotonic() + PATIENCE
        while not condition():
            self.assertLess(time.monotonic(), limit, f'{what} did not happen within {PATIENCE} s')
            time.sleep(.05)

    def test_interrupted_resumed_and_complete(self):
        program = self.wrapper('slow', .7)
        with open(self.folder / 'interrupted.log', 'w') as log:
            process = subprocess.Popen(self.command(program, 'out'), stdout=log, stderr=log, env=self.environment())
            self.wait_for(lambda: len(self.records('out')) >= 2 or process.poll() is not None, 'the second run')
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(PATIENCE), 130, (self.folder / 'interrupted.log').read_text())
        self.assertEqual(self.processes_of('slow'), [], 'left behind by the interruption')
        done = {path: path.stat().st_mtime_ns for path in self.records('out')}
        self.assertLess(len(done), 6)  # of six runs: four of room, two of static
        again = self.evaluate(program, 'out')
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertIn('6 runs, 1 failed', again.stdout)
        self.assertEqual(len(self.records('out')), 6)
        for path, changed in done.items():
            self.assertEqual(path.stat().st_mtime_ns, changed, f'{path} was run twice')
        self.check_results()
        self.check_third_time(program)
        self.check_results_page()

    def check_results(self):
        out, rows = self.folder / 'out', self.rows('out')
        room, static, total = rows['room', 'orb'], rows['static', 'orb'], rows['TOTAL', 'orb']
        self.assertEqual((room['runs'], room['crash'], room['init'], static['runs'], static['init']), ('4', '1', '3', '2', '0'))
        self.assertEqual(total['runs'], '4')  # a sequence without motion is no part of it
        # measured on this room: direction 0.5 to 2.5 degrees, depth 1.5 %, ATE 0.1 % of the way; margin x4
        self.assertLess(float(room['dir']), 10)
        self.assertLess(float(room['depth']), .06)
        self.assertLess(float(room['ate']), .004)
        command = (out / 'failed.txt').read_text()
        self.assertRegex(command, r'^1\t\S+/slow \S+/room --format auto --initializer orb --start 10 --end 30 ')
        page = (out / 'report.html').read_text()
        self.assertIn('--start 10', page)
        self.assertNotRegex(page, r'src="(?!data:image/png;base64,)')
        self.assertNotRegex(page, r'<link|<script|url\(')
        self.assertGreaterEqual(len(re.findall('src="data:image/png', page)), 6)
        self.assertIn('evo computed ATE and RPE of', page)
        names = ['all_initial', 'all_trajectory', 'room_initial', 'overlay_room', 'evo_room_trajectories']
        if package.load(self.folder):
            names += ['residuals_orb', 'epipolar_search_orb']
        for name in names:
            self.assertTrue((out / 'figures' / f'{name}.png').read_bytes().startswith(b'\x89PNG'), name)
        self.assertTrue((out / 'tables/room.md').exists() and (out / 'tables/static.csv').exists())
        self.check_evo(out)

    def check_evo(self, out):
        """What evo found beside what we found, in the real runs."""
        found = [json.loads(path.with_name('figures.json').read_text()).get('frames') for path in self.records('out')]
        found = [figures for figures in found if figures]
        self.assertTrue(found)
        for figures in found:
            self.assertAlmostEqual(figures['evo']['ate'], figures['ate'], delta=1e-6 * figures['ate'])
            self.assertAlmostEqual(figures['evo']['rpe'], figures['rpe'], delta=1e-6 * figures['rpe'])

    def check_third_time(self, program):
        """Nothing is left to do: same files, byte by byte."""
        out = self.folder / 'out'
        files = [out / 'summary.csv', out / 'summary.md', out / 'report.html', *sorted((out / 'figures').glob('[ar]*.png'))]
        before, records = [f.read_bytes() for f in files], [p.stat().st_mtime_ns for p in self.records('out')]
        again = self.evaluate(program, 'out', '--report-only')
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertEqual([p.stat().st_mtime_ns for p in self.records('out')], records)
        for file, content in zip(files, before):
            self.assertEqual(file.read_bytes(), content, file.name)

    def check_results_page(self):
        """Our rows beside those of others; better and worse as the numbers say; refused where runs are missing."""
        out, page, others = self.folder / 'out', self.folder / 'page' / 'results.md', self.folder / 'others.csv'
        page.parent.mkdir()
        others.write_text('protocol,method,sequence,runs,init,dir,ate\ndense,reference,room,4,4,90,1e-9\nfive,reference,room,3,3,1,1\n')
        command = [sys.executable, str(SCRIPTS / 'results_page.py'), '--five', str(out), '--dense', str(out), '--others', str(others),
                   '--output', str(page)]
        made = subprocess.run(command, capture_output=True, text=True, env=self.environment())
        self.assertEqual(made.returncode, 0, made.stderr)
        text, room = page.read_text(), self.rows('out')['room', 'orb']
        dense, five = text.split("## Gladkova's protocol")
        self.assertIn('| room | *reference* | 4 | 4 |', dense)
        better, worse = dense.split('- `orb` is worse')
        self.assertIn(f'  - room: dir {float(room["dir"]):.4g} (90)', better)
        self.assertRegex(worse, r'  - room: init 3 \(4\), ate \S+ \(1e-09\)')
        self.assertIn('`orb` is better than the reference in no column', five)  # other runs are not compared
        for picture in re.findall(r'!\[[^]]*\]\(([^)]*)\)', text):
            self.assertTrue((page.parent / picture).exists(), picture)
        others.write_text('protocol,method,sequence,runs,init\ndense,reference,room,4,many\n')
        made = subprocess.run(command, capture_output=True, text=True, env=self.environment())
        self.assertEqual((made.returncode, made.stderr.count('line 2')), (2, 1), made.stderr)

    def test_ends_what_does_not_end_when_asked(self):
        deaf = subprocess.Popen(['sh', '-c', 'trap "" TERM; echo ready; sleep 600'], stdout=subprocess.PIPE, start_new_session=True)
        with deaf.stdout:
            deaf.stdout.readline()
        with unittest.mock.patch.multiple(cli, REQUESTS=2, PATIENCE=.05):
            cli.end(deaf)
        self.assertEqual(deaf.returncode, -signal.SIGKILL)

    def test_other_configurations_stay_apart_and_a_profile_can_take_the_runs(self):
        program = self.wrapper('quick', 0)
        first = self.evaluate(program, 'apart', '--no-evo', '--jobs', '2')
        self.assertEqual(first.returncode, 0, first.stderr)
        before = set(self.records('apart'))
        for profile in ('slurm', 'kubernetes'):
            dry = self.evaluate(program, 'apart', '--no-evo', '--extra=--set tracker.max_rmse=13', '--dry-run', '--profile',
                                str(SCRIPTS / 'profiles' / profile))
            self.assertEqual(dry.returncode, 0, dry.stderr)
            self.assertRegex(dry.stderr, r'\n    output files have to be generated:\n        run\n')
            # all six are new: nothing of the other configuration is taken
            self.assertRegex((self.folder / 'apart/log/snakemake.log').read_text(), r'\nrun +6\n')
        self.assertEqual(set(self.records('apart')), before)


if __name__ == '__main__':
    unittest.main()
