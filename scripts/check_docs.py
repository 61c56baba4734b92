#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Checks README.md, CONTRIBUTING.md, CHANGELOG.md and docs/*.md: links to files and headings exist, and a code block
after `<!-- code: FILE NAME -->` is what stands in FILE between the lines `// [NAME]` and `// [/NAME]`. Tests that
inputs_images.md names exist.
With --update the code blocks are written."""
import argparse
import pathlib
import re
import sys
import textwrap

ROOT = pathlib.Path(__file__).resolve().parent.parent
LINK = re.compile(r'(?<!!)\[[^\]]*\]\(([^)\s]+)\)|!\[[^\]]*\]\(([^)\s]+)\)')
CODE = re.compile(r'(<!-- code: (\S+) (\S+) -->\n```\w*\n)(.*?)(```\n)', re.S)


def region(file, name):
    text = (ROOT / file).read_text()
    found = re.search(rf'^ *// \[{name}\]\n(.*?)^ *// \[/{name}\]\n', text, re.S | re.M)
    if not found:
        raise SystemExit(f'{file}: no lines "// [{name}]" and "// [/{name}]"')
    return textwrap.dedent(found.group(1))


def anchors(text):
    """Headings as GitHub names them."""
    without_code = re.sub(r'^```.*?^```', '', text, flags=re.S | re.M)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-')
            for heading in re.findall(r'^#+ (.+)$', without_code, re.M)}


def broken_links(page, text):
    for match in LINK.finditer(re.sub(r'^```.*?^```', '', text, flags=re.S | re.M)):
        target = match.group(1) or match.group(2)
        if re.match(r'[a-z]+:', target):
            continue
        path, _, anchor = target.partition('#')
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            yield f'{page.relative_to(ROOT)}: {target}: no such file'
        elif anchor and file.suffix == '.md' and anchor not in anchors(file.read_text()):
            yield f'{page.relative_to(ROOT)}: {target}: no such heading'


def unshown_fields(page, text):
    """Rows of the tables of what is read whose word or test is none."""
    tests = ''.join(file.read_text() for file in (ROOT / 'test').rglob('*_test.cpp'))
    tests += ''.join(file.read_text() for file in (ROOT / 'test').rglob('test_*.py'))
    for row in re.findall(r'^\| (.+) \|$', text, re.M)[1:]:
        *_, treatment, _, test = row.split(' | ') if row.count(' | ') == 4 else row.replace(' | |', ' |  |').split(' | ')
        if treatment.strip() not in ('used', 'told', 'refused', 'ignored'):
            yield f'{page.relative_to(ROOT)}: "{treatment}" of "{row}": expected used, told, refused or ignored'
        if not re.search(rf'\b{test.strip()}\b', tests):
            yield f'{page.relative_to(ROOT)}: {test}: no such test'


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--update', action='store_true', help='write the code blocks')
    update = parser.parse_args().update
    errors, links, blocks = [], 0, 0
    pages = sorted(ROOT.glob('*.md')) + sorted((ROOT / 'docs').rglob('*.md'))
    for page in pages:
        text = page.read_text()
        current = CODE.sub(lambda m: m.group(1) + region(m.group(2), m.group(3)) + m.group(5), text)
        blocks += len(CODE.findall(text))
        links += len(LINK.findall(text))
        if current != text and update:
            page.write_text(current)
        elif current != text:
            errors.append(f'{page.relative_to(ROOT)}: a code block is not what its file has; {sys.argv[0]} --update writes it')
        errors += broken_links(page, text)
        errors += unshown_fields(page, text) if page.name == 'inputs_images.md' else []
    print('\n'.join(errors) or f'docs: {len(pages)} pages, {links} links, {blocks} code blocks are as they should be')
    return 1 if errors else 0


if __name__ == '__main__':
    sys.exit(main())
