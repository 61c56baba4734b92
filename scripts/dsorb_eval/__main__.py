# SPDX-License-Identifier: BSD-3-Clause
"""One step of a workflow: `python -m dsorb_eval run PLAN KEY RECORD` or `report PLAN` of an evaluation, `video LIST NAME
RECORD TIMEOUT COMMAND ARGUMENTS` or `table LIST TABLE` of a collection."""
import json
import sys
from pathlib import Path


def run(plan_file, key, record_file):
    """One run of the plan with its figures, beside the record."""
    from . import runner, store
    runner.install_terminate_handler()
    plan = json.loads(Path(plan_file).read_text())
    entry = next(e for e in plan['runs'] if e['key'] == key)
    sequence = next(s for s in plan['sequences'] if s['name'] == entry['sequence'])
    target = Path(record_file).parent
    record = runner.run_one(entry, target, plan['timeout'])
    store.figures_of(record, target, sequence, plan['evo'])


def main():
    if sys.argv[1:2] == ['run'] and len(sys.argv) == 5:
        run(*sys.argv[2:])
    elif sys.argv[1:2] == ['report'] and len(sys.argv) == 3:
        from . import report
        report.write(Path(sys.argv[2]).parent)
    elif sys.argv[1:2] == ['video'] and len(sys.argv) == 8:
        from . import collection, runner
        runner.install_terminate_handler()
        collection.run(sys.argv[2], sys.argv[3], sys.argv[4], int(sys.argv[5]), *sys.argv[6:])
    elif sys.argv[1:2] == ['table'] and len(sys.argv) == 4:
        from . import collection
        print(collection.write_table(*sys.argv[2:]))
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main()
