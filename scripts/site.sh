#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# The documentation as a site of plain HTML: site.sh [FOLDER] (default build/site). Pages are README, CHANGELOG,
# CONTRIBUTING, the ROS 2 node and docs/ by the Python package markdown (installed in build/markdown where it is missing); a link
# to nothing is an error. api/ is the reference of the public headers, checked and made by docs.sh.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-build/site}
python=${DSORB_PYTHON:-python3}
"$python" -c 'import markdown' 2>/dev/null || {
  "$python" -m venv build/markdown
  python=build/markdown/bin/python
  "$python" -m pip install -q --disable-pip-version-check markdown
}
rm -rf "$folder" && mkdir -p "$folder"
scripts/docs.sh "$folder/doxygen" >/dev/null
mv "$folder/doxygen/html" "$folder/api" && rm -r "$folder/doxygen"
cp -r docs "$folder/" && find "$folder/docs" -name '*.md' -delete
"$python" - "$folder" <<'END'
import re
import sys
from pathlib import Path

import markdown

folder = Path(sys.argv[1])
style = 'body{max-width:60em;margin:2em auto;padding:0 1em;font:16px/1.5 sans-serif}pre{background:#f4f4f4;padding:.6em;overflow:auto}' \
    'code{background:#f4f4f4}table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.2em .5em}img{max-width:100%}nav{border-bottom:1px solid #ccc}'
pages = [*sorted(Path('.').glob('*.md')), *sorted(Path('docs').rglob('*.md')), Path('scripts/ros2/dsorb_ros/README.md')]
for page in pages:
    html = markdown.markdown(page.read_text(encoding='utf-8'), extensions=['tables', 'fenced_code', 'toc'])
    html = re.sub(r'(href="[^":]*)README\.md', r'\1index.html', html)
    html = re.sub(r'(href="[^":]*)\.md([#"])', r'\1.html\2', html)
    up = '../' * (len(page.parts) - 1)
    links = ' · '.join(f'<a href="{up}{target}">{name}</a>' for target, name in (('index.html', 'dsorb'), ('docs/python.html', 'Python'), (
        'docs/running.html', 'program'), ('docs/library.html', 'C++'), ('docs/limits.html', 'limits'), ('api/index.html', 'reference')))
    target = folder / (page.with_name('index.html') if page.name == 'README.md' else page.with_suffix('.html'))
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(f'<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>dsorb: {page.stem}</title>'
                      f'<style>{style}</style><nav>{links}</nav>{html}', encoding='utf-8')
for page in (page for page in folder.rglob('*.html') if folder / 'api' not in page.parents):
    for link in re.findall(r'(?:href|src)="([^"#:]+)["#]', page.read_text(encoding='utf-8')):
        if not (page.parent / link).exists():
            sys.exit(f'site.sh: {page}: {link}: no such file')
print(f'{len(pages)} pages: {folder}/index.html')
END
