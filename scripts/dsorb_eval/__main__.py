# SPDX-License-Identifier: BSD-3-Clause
"""One step of the workflow: `python -m dsorb_eval run FOLDER KEY` or `python -m dsorb_eval report FOLDER`."""
import json
import sys
from pathlib import Path


def run(folder, key):
    """One run of the plan with its figures."""
    from . import runner, store
    runner.install_terminate_handler()
    plan = json.loads((Path(folder) / 'plan.json').read_text())
    entry = next(e for e in plan['runs'] if e['key'] == key)
    sequence = next(s for s in plan['sequences'] if s['name'] == entry['sequence'])
    target = Path(folder) / 'runs' / key
    record = runner.read_record(target) or runner.run_one(entry, target, plan['timeout'])
    store.figures_of(record, target, sequence, plan['evo'])


def main():
    if sys.argv[1:2] == ['run'] and len(sys.argv) == 4:
        run(*sys.argv[2:])
    elif sys.argv[1:2] == ['report'] and len(sys.argv) == 3:
        from . import report
        report.write(sys.argv[2])
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main()
