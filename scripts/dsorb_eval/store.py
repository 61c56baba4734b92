# SPDX-License-Identifier: BSD-3-Clause
"""An output folder: plan.json, and under runs/<key>/ each run's record.json, figures.json, log.txt and out/."""
import json
from pathlib import Path

from . import judge, summary
from .protocol import dump_json, write_if_changed
from .runner import FIGURES, read_record


class Evaluation:
    """A plan with what was found of it in the output folder."""

    def __init__(self, folder):
        self.folder = Path(folder).resolve()  # other programs are called from folders of their own
        self.plan = json.loads((self.folder / 'plan.json').read_text())
        self.sequences = {s['name']: s for s in self.plan['sequences']}
        self.runs = [self.load(entry) for entry in self.plan['runs']]

    def folder_of(self, run):
        return self.folder / 'runs' / run.entry['key']

    def load(self, entry):
        """A run with its figures; judged anew where another version of the judge did it."""
        run = summary.Run(entry)
        run.record = read_record(self.folder_of(run))
        if run.record:
            run.figures = figures_of(run.record, self.folder_of(run), self.sequences[entry['sequence']], self.plan['evo'])
        return run

    def done(self):
        return [run for run in self.runs if run.record]


def figures_of(record, folder, sequence, with_evo):
    """The figures of a recorded run, from figures.json where this judge wrote it."""
    path = folder / FIGURES
    try:
        figures = json.loads(path.read_text())
    except (OSError, ValueError):
        figures = {}
    if figures.get('judge') != judge.version() or figures.get('evo') != bool(with_evo):
        figures = judge.judge(record, folder, sequence, with_evo)
        write_if_changed(path, dump_json(figures))
    return figures
