#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Headers of ROS 2 messages from the definitions that the package rosbags brings: make_messages.py FOLDER [NAME...].

A stand-in for what rosidl generates, for compiling and testing dsorb_ros where ROS is not installed: structs with the members
of the messages, and `fields(archive, message)` that reads or writes them as the wire has them."""
import sys
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

NAMES = ['sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/CameraInfo', 'sensor_msgs/msg/PointCloud2',
         'nav_msgs/msg/Odometry', 'nav_msgs/msg/Path', 'tf2_msgs/msg/TFMessage']
BASE = {'string': 'std::string', 'bool': 'bool', 'float32': 'float', 'float64': 'double', 'byte': 'std::uint8_t', 'char': 'char'}
NAME, SEQUENCE_TYPES, ARRAY, PRIMITIVE = 2, (4,), 3, 1


def snake(name):
    text = ''
    for i, letter in enumerate(name):
        begins = letter.isupper() and i > 0 and (not name[i - 1].isupper() or name[i + 1:i + 2].islower())
        text += ('_' if begins else '') + letter.lower()
    return text


def header_of(name):
    package, kind, message = name.split('/')
    return f'{package}/{kind}/{snake(message)}.hpp'


def type_of(definition):
    """C++ type of a field, and the messages it needs."""
    kind, what = int(definition[0]), definition[1]
    if kind == PRIMITIVE:
        return BASE.get(what[0], f'std::{what[0]}_t'), []
    if kind == NAME:
        return what.replace('/', '::'), [what]
    element, needs = type_of(what[0])
    return (f'std::array<{element}, {what[1]}>' if kind == ARRAY else f'std::vector<{element}>'), needs


def write(store, name, folder, done):
    if name in done:
        return
    done.add(name)
    constants, fields = store.fielddefs[name]
    typed = [(field, *type_of(definition)) for field, definition in fields]
    needed = sorted({need for _, _, needs in typed for need in needs})
    for need in needed:
        write(store, need, folder, done)
    package, kind, message = name.split('/')
    members = ''.join(f'  {cpp} {field}{{}};\n' for field, cpp, _ in typed)
    members += ''.join(f'  static constexpr {type_of((PRIMITIVE, (base, 0)))[0]} {key} = {value};\n' for key, base, value in constants)
    includes = ''.join(f'#include "{header_of(need)}"\n' for need in needed)
    walk = ''.join(f'  archive(message.{field});\n' for field, _, _ in typed)
    text = f'''#pragma once
#include "cdr.h"
{includes}
namespace {package}::{kind} {{
struct {message} {{
  using SharedPtr = std::shared_ptr<{message}>;
  using ConstSharedPtr = std::shared_ptr<const {message}>;
  static constexpr const char* kName = "{name}";
{members}}};
template <typename Archive>
void fields(Archive& archive, {message}& message) {{
{walk}}}
}}  // namespace {package}::{kind}
'''
    path = folder / header_of(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding='utf-8')


def main():
    folder, names = Path(sys.argv[1]), sys.argv[2:] or NAMES
    store, done = get_typestore(Stores.ROS2_HUMBLE), set()
    for name in names:
        write(store, name, folder, done)


if __name__ == '__main__':
    main()
