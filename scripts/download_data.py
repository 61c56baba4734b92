#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fetches public data sets from their official addresses (scripts/datasets.yaml) and unpacks them.

    scripts/download_data.py                       what there is
    scripts/download_data.py euroc --to DIR        a whole data set
    scripts/download_data.py euroc/V1_01_easy      one file of it

An interrupted download goes on where it stopped. Where a licence must be accepted first, it says what to do by hand. At the
end DIR/sequences.yaml lists what is there, for scripts/evaluate.py."""
import argparse
import sys
from pathlib import Path

from evaluate import HERE, use_environment


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', nargs='*', metavar='NAME[/FILE]', help='data sets, or single files of them')
    parser.add_argument('--to', default='data', metavar='DIR', help='download folder; default data')
    parser.add_argument('--keep-archives', action='store_true', help='keep what was unpacked')
    parser.add_argument('--catalogue', default=str(Path(HERE) / 'datasets.yaml'), metavar='FILE', help='default scripts/datasets.yaml')
    return parser.parse_args()


def list_all(catalogue):
    for name, entry in catalogue.items():
        files = ', '.join(entry.get('files', {})) or 'by hand'
        print(f"{name}: {entry['about']}\n    {entry['page']}\n    licence: {entry['licence']}\n    files: {files}")


def bar_of(name):
    """Progress bar of a download as a function of (bytes so far, bytes in all)."""
    from tqdm import tqdm
    bar = tqdm(unit='B', unit_scale=True, desc=name, disable=None)

    def show(have, total):
        bar.total = total
        bar.update(have - bar.n)
    return bar, show


def get(word, catalogue, args, download):
    """One word of the command line. @throws DownloadError"""
    name, _, single = word.partition('/')
    entry, folder = catalogue.get(name), Path(args.to)
    if entry is None or single and single not in entry.get('files', {}):
        raise download.DownloadError(f'{word}: unknown; known: {", ".join(catalogue)} (without arguments their files are listed)')
    if 'manual' in entry:
        print(f"{name} ({entry['page']}, {entry['licence']}) must be fetched by hand:\n{entry['manual'].replace('{folder}', str(folder))}")
        return
    print(f"{name}: {entry['licence']}, {entry['page']}")
    for file, details in entry['files'].items():
        if single in ('', file):
            bar, show = bar_of(file)
            with bar:
                done = download.get_file(file, details, folder, show, args.keep_archives)
            print(f'  {file}: {"done" if done else "was there already"}')
    for path, text in entry.get('write', {}).items():
        if (folder / path).parent.is_dir():
            (folder / path).write_text(text)


def main():
    args = parse_arguments()
    try:
        from dsorb_eval import download
    except ImportError as error:
        return f'download_data.py: {error}; run scripts/venv.sh first'
    try:
        catalogue = download.read_catalogue(args.catalogue)
        if not args.what:
            list_all(catalogue)
            return 0
        for word in args.what:
            get(word, catalogue, args, download)
        if Path(args.to).is_dir():
            path, names = download.write_sequences(catalogue, Path(args.to))
            print(f'{path}: {", ".join(names) or "nothing yet"}')
    except (download.DownloadError, ValueError, OSError) as error:
        return f'download_data.py: {error}'
    except KeyboardInterrupt:
        print('\ninterrupted; the same command goes on where this one stopped', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    sys.exit(main())
