#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Shows a run in the Rerun viewer, after or during it.

    dso_dataset DATASET --output OUT --record OUT/recording.jsonl
    scripts/view_rerun.py OUT                      a window
    scripts/view_rerun.py OUT --save run.rrd       no window; open run.rrd with `rerun run.rrd`
    scripts/view_rerun.py OUT --follow             while the run goes on"""
import argparse
import sys

from evaluate import HERE, use_environment


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('run', metavar='OUT_DIR', help='output folder of a run with a recording in it, or the recording itself')
    parser.add_argument('--save', metavar='FILE.rrd', help='write a file instead of opening a window')
    parser.add_argument('--follow', action='store_true', help='go on with what a running program appends')
    parser.add_argument('--patience', type=float, default=60., metavar='S', help='with --follow: give up after so many seconds '
                        'without news; default 60')
    parser.add_argument('--max-sigma', type=float, default=.3, metavar='X', help='points whose inverse depth is less certain '
                        'than this share of it are left out; default 0.3')
    return parser.parse_args()


def main():
    args = parse_arguments()
    try:
        from dsorb_eval import recording, rerun_view
    except ImportError as error:
        return f'view_rerun.py: {error}; run scripts/venv.sh first'
    try:
        images = rerun_view.show(recording.find(args.run), args.save, args.follow, args.patience, args.max_sigma)
    except (OSError, ValueError) as error:
        return f'view_rerun.py: {error}'
    except KeyboardInterrupt:
        return 130
    print(f'{images} images' + (f'; {args.save}' if args.save else ''))
    return 0


if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    sys.exit(main())
