#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes docs/configuration.md: every key with its default and range, as `dso_dataset --print-config` has them, and what
the comments of include/dsorb/options say of it. configuration_reference.py DSO_DATASET [--check]"""
import argparse
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / 'docs' / 'configuration.md'
HEAD = '''# Configuration

Every key of a configuration file (`--config`, `--set key=value`; the end of a key is enough where it is unique). `scripts/configuration_reference.py` makes this page.
'''


def struct_members(text):
    """{struct: {member: (type, comment)}}"""
    structs = {}
    for struct in re.finditer(r'^struct (\w+) \{\n(.*?)^\};', text, re.S | re.M):
        members, before, last = {}, [], None
        for line in struct.group(2).splitlines():
            comment = re.match(r'\s*///(<?)\s?(.*)', line)
            member = re.match(r'\s*([\w:]+) (\w+)(?: = [^;]+)?;(?:\s*///<\s?(.*))?', line)
            if member:
                last = member.group(2)
                members[last] = (member.group(1), ' '.join(before + [member.group(3) or '']).strip())
                before = []
            elif comment and comment.group(1) and last:
                kind, said = members[last]
                members[last] = (kind, f'{said} {comment.group(2)}'.strip())
            elif comment:
                before.append(comment.group(2))
        structs[struct.group(1)] = members
    return structs


def enum_comments(text):
    """{enumeration: what stands above it, without formulas' sources}"""
    comments = {}
    for lines, name in re.findall(r'((?:^///.*\n)+)enum class (\w+)', text, re.M):
        comments[name] = ' '.join(line[3:].strip() for line in lines.splitlines() if '@' not in line)
    return comments


def descriptions():
    """{key: comment}, by the field lists that stand beside the structs."""
    text = '\n'.join(p.read_text() for p in sorted((ROOT / 'include/dsorb/options').glob('*.h')))
    structs, enums = struct_members(text), enum_comments(text)
    fields = {m.group(1): m.group(2) for m in
              re.finditer(r'DescribeFor<Options, (\w+)> describe\(.*?\{\n(.*?)^\}', text, re.S | re.M)}
    found = {}

    def visit(struct, prefix):
        for how, name, member in re.findall(r'visit\.(\w+)\(\s*"(\w+)",\s*o\.(\w+)', fields[struct]):
            kind, said = structs[struct][member]
            if how == 'group':
                visit(kind, f'{prefix}{name}.')
            else:
                found[prefix + name] = enums.get(kind) or said
    visit('OdometryOptions', '')
    return found


def printed_keys(program):
    """(key, default, range) of each line of --print-config, in its order."""
    text = subprocess.run([program, '--print-config', '--threads', '0'], check=True, capture_output=True, text=True).stdout
    path = []
    for line in text.splitlines():
        indent, name, value, allowed = re.match(r'( *)(\w+):(?: (\S+)  # (.*))?$', line).groups()
        path[len(indent) // 2:] = [name]
        if value is not None:
            yield '.'.join(path), value, allowed


def page_text(program):
    said = descriptions()
    text, group = HEAD, None
    for key, value, allowed in printed_keys(program):
        parent, _, name = key.rpartition('.')
        if parent != group:
            group = parent
            text += f'\n## {parent or "At the top"}\n\n| key | default | takes | |\n|---|---|---|---|\n'
        allowed = re.sub(r'^a whole number in ', 'whole, ', re.sub(r'^(a number in|one of) ', '', allowed))
        comment = said[key].replace('|', '\\|')
        text += f'| `{name}` | {value} | {allowed} | {comment} |\n'
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('program', help='dso_dataset')
    parser.add_argument('--check', action='store_true', help='fail where the page is out of date')
    args = parser.parse_args()
    text = page_text(args.program)
    if not args.check:
        PAGE.write_text(text)
    elif not PAGE.exists() or PAGE.read_text() != text:
        print(f'docs/configuration.md is out of date: scripts/configuration_reference.py {args.program} writes it')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
