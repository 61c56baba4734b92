#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Checks the pages (README.md, CONTRIBUTING.md, CHANGELOG.md, docs, docs/lab) and how comments begin.

- Links to files and headings exist.
- A code block after `<!-- code: FILE NAME -->` is what stands in FILE between the lines `// [NAME]` and `// [/NAME]`.
- Tests that inputs_images.md names exist, and sources that how-it-works.md names.
- README.md and docs/*.md, without the generated configuration.md, have at most 20,000 words, tables and code included.
- CMakeLists.txt, CITATION.cff and the ROS 2 node's package.xml have one version, and CHANGELOG.md a heading for it.
- No comment of the sources, and no sentence in one, begins with a word that leaves its subject out; those of the library
  do not send to docs/lab.

With --update the code blocks are written."""
import argparse
import pathlib
import re
import sys
import textwrap

ROOT = pathlib.Path(__file__).resolve().parent.parent
LINK = re.compile(r'(?<!!)\[[^\]]*\]\(([^)\s]+)\)|!\[[^\]]*\]\(([^)\s]+)\)')
MAX_WORDS = 20000
SOURCES = ('.h', '.cpp', '.c', '.py', '.pyi', '.sh', '.cmake', '.txt')
BEGINNING = re.compile(r'(//+<?|#|/?\*+|""")(.*[.:;!?])? ?(Of|That|By) ')
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


def faulty_words():
    """Lines of the sources whose comments leave their subject out, or send to the laboratory book."""
    for folder in ('include', 'src', 'test', 'scripts'):
        for file in sorted((ROOT / folder).rglob('*')):
            if file.suffix not in SOURCES or file == pathlib.Path(__file__).resolve() or 'corpus' in file.parts:
                continue
            for number, line in enumerate(file.read_text(errors='replace').splitlines(), 1):
                found = BEGINNING.search(line)
                place = f'{file.relative_to(ROOT)}:{number}'
                if found:
                    yield f'{place}: a comment begins with "{found.group(3)}": expected a sentence or a noun phrase'
                if folder in ('include', 'src') and 'docs/lab' in line:
                    yield f'{place}: expected the figure instead of a page of docs/lab'


def lost_sources(page, text):
    """Sources of src or include that a page names and that do not exist."""
    for name in sorted(set(re.findall(r'`([\w/]+/[\w/]+\.(?:h|cpp))`', text))):
        if not any((ROOT / folder / name).exists() for folder in ('src', 'include', 'include/dsorb')):
            yield f'{page.relative_to(ROOT)}: {name}: no such source'


def other_versions():
    """Files whose version is not that of CMakeLists.txt."""
    version = re.search(r'project\(dsorb VERSION ([\d.]+)', (ROOT / 'CMakeLists.txt').read_text()).group(1)
    for file, form in (('CITATION.cff', '\nversion: {}\n'), ('scripts/ros2/dsorb_ros/package.xml', '<version>{}<'), ('CHANGELOG.md', '\n## {}')):
        if form.format(version) not in (ROOT / file).read_text():
            yield f'{file}: expected the version {version} of CMakeLists.txt: {form.format(version).strip()}'


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
        errors += lost_sources(page, text) if page.name == 'how-it-works.md' else []
    user_pages = [ROOT / 'README.md', *(p for p in (ROOT / 'docs').glob('*.md') if p.name != 'configuration.md')]
    words = sum(len(page.read_text().split()) for page in user_pages)
    if words > MAX_WORDS:
        errors.append(f'README.md and docs/*.md have {words} words: expected {MAX_WORDS} at most; measurements and lists go to docs/lab')
    errors += [*faulty_words(), *other_versions()]
    print('\n'.join(errors) or f'docs: {len(pages)} pages, {links} links, {blocks} code blocks and {words} words for users are as they should be')
    return 1 if errors else 0


if __name__ == '__main__':
    sys.exit(main())
