#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when a source file includes what its layer may not know (data flows one way), when two headers define a type
of one name in one namespace (programs that include both are undefined, and no compiler says so), or when a file of tests
is in no program."""
import re
import subprocess
import sys

# folder -> project folders it may include besides itself; public and private headers alike
MAY_INCLUDE = {
    'options': set(),
    'platform': set(),
    'base': {'options'},
    'geometry': {'base'},
    'camera': {'geometry', 'base', 'options'},
    'image': {'camera', 'geometry', 'base', 'options'},
    'estimate': {'image', 'camera', 'geometry', 'base', 'options'},
    'features': {'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'two_view': {'features', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'init': {'window', 'depth', 'two_view', 'features', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'published': {'init', 'two_view', 'features', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'track': {'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'depth': {'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'window': {'depth', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'odometry': {'window', 'track', 'depth', 'init', 'features', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'place': {'odometry', 'init', 'features', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'self_calibration': {'odometry', 'features', 'estimate', 'image', 'camera', 'geometry', 'base', 'options'},
    'c': {'odometry', 'init', 'image', 'camera', 'geometry', 'base', 'options'},
    'synthetic': {'image', 'camera', 'geometry', 'base', 'options'},
    'io': {'platform', 'self_calibration', 'odometry', 'init', 'image', 'camera', 'geometry', 'base', 'options'},
    'python': {'platform', 'published', 'self_calibration', 'io', 'odometry', 'init', 'image', 'camera', 'geometry', 'base', 'options'},
    'app': {'platform', 'place', 'published', 'self_calibration', 'io', 'odometry', 'init', 'synthetic', 'image', 'camera', 'geometry', 'base', 'options'},
}
# the last step of camera makes the first thing of image
BRIDGES = {'include/dsorb/camera/rectifier.h': 'image', 'src/camera/rectifier.cpp': 'image'}
# rooms of src/init/orb and src/io -> rooms of the same folder each may include; files of the folder itself may include all
ROOMS = {
    'init/orb': {'map': set(), 'bundle': {'map'}, 'start': {'map', 'bundle'}},
    'io': {'calibration': set(), 'input': {'calibration'}, 'output': {'calibration'}},
}
# third-party header -> folders (or file prefixes) that may use it
THIRD_PARTY = {
    r'opencv2/': ('src/camera/undistorter', 'src/features/', 'src/self_calibration/', 'src/two_view/', 'src/init/orb/', 'src/published/', 'src/place/', 'src/io/', 'src/app/'),
    r'ceres/': ('src/published/', 'src/place/'),
    r'sqlite3': ('src/place/',),
    r'tbb/|oneapi/': ('src/base/', 'src/odometry/', 'src/io/input/sequence_reader'),
    r'yaml-cpp/': ('src/io/',),
    r'nlohmann/': ('src/io/',),
    r'zip\.h': ('src/io/',),
    r'lib(av|sws)\w+/': ('src/io/input/ffmpeg_capture',),
    r'fmt/': ('src/io/', 'src/app/'),
    r'spdlog/': ('src/app/',),
    r'CLI/': ('src/app/',),
    r'(unistd|fcntl|poll|io|windows|psapi|pthread|sys/(file|mman|resource|stat|types|wait))\.h': ('src/platform/',),
    r'nanobind/': ('src/python/',),
}
NAMESPACE = re.compile(r'^namespace ([\w:]+) \{', re.MULTILINE)
TYPE = re.compile(r'^(?:struct|class|enum class) (\w+)[^;{]*\{', re.MULTILINE)
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')


def folder_of(path):
    parts = path.split('/')
    return parts[2] if path.startswith('include/dsorb/') and len(parts) > 3 else \
        parts[1] if path.startswith('src/') and len(parts) > 2 else None


def room_of(path):
    """(folder, room) of a file in a folder that has rooms; room is '' for its top."""
    for folder in ROOMS:
        match = re.match(rf'(?:src/)?{folder}/(?:(\w+)/)?', path)
        if match:
            return folder, match.group(1) or ''
    return None, None


def wrong_room(path, header):
    (folder, room), (target_folder, target) = room_of(path), room_of(header)
    if not room or folder != target_folder or not target or target in ROOMS[folder].get(room, ()) or target == room:
        return None
    return f'{folder}/{room} may not include {header}'


def defined_twice(paths):
    """Types that several headers define in the same namespace."""
    headers = {}
    for path in paths:
        if not path.endswith('.h'):
            continue
        with open(path, encoding='utf-8') as file:
            text = file.read()
        scope = NAMESPACE.search(text)
        for name in TYPE.findall(text):
            headers.setdefault(f'{scope.group(1) if scope else ""}::{name}', []).append(path)
    return [f'{name} is defined in {" and ".join(found)}' for name, found in headers.items() if len(found) > 1]


def wrong_includes(path):
    folder, public = folder_of(path), path.startswith('include/')
    with open(path, encoding='utf-8') as file:
        lines = file.readlines()
    for number, line in enumerate(lines, 1):
        match = INCLUDE.match(line)
        if not match:
            continue
        header = match.group(2)
        target = header.removeprefix('dsorb/').split('/')[0] if '/' in header.removeprefix('dsorb/') else None
        if match.group(1) == '"' and target in MAY_INCLUDE and folder and target != folder:
            if target not in MAY_INCLUDE[folder] and BRIDGES.get(path) != target:
                yield number, f'{folder} may not include {header}'
            if folder == 'odometry' and target == 'init' and not header.startswith('dsorb/'):
                yield number, f'odometry may include init through dsorb/init only, not {header}'
            if folder == 'published' and re.match(r'init/orb/(?!map/|bundle/)', header):
                yield number, f'published may include corners and their covariances of orb only, not {header}'
            if folder == 'place' and target in ('odometry', 'init') and not header.startswith('dsorb/'):
                yield number, f'place may include {target} through public headers only, not {header}'
            if folder in ('app', 'python') and target in ('published', 'place') and not header.startswith('dsorb/'):
                yield number, f'{folder} may include {target} through public headers only, not {header}'
            if folder == 'io' and target in ('odometry', 'init', 'image') and not header.startswith('dsorb/'):
                yield number, f'io may include {target} through public headers only, not {header}'
        if public and match.group(1) == '"' and not header.startswith('dsorb/'):
            yield number, f'a public header may not include the private {header}'
        if match.group(1) == '"' and wrong_room(path, header):
            yield number, wrong_room(path, header)
        for pattern, allowed in THIRD_PARTY.items():
            if match.group(1) == '<' and re.match(pattern, header) and not path.startswith(allowed):
                yield number, f'{header} may be included only in {", ".join(allowed)}'


def tests_in_no_program():
    paths = subprocess.run(['git', 'ls-files', 'test/*_test.cpp'], capture_output=True, text=True, check=True).stdout.split()
    with open('test/CMakeLists.txt') as file:
        listed = file.read()
    return [f'{path}: in no program of test/CMakeLists.txt' for path in paths
            if path.removeprefix('test/') not in listed]


def main():
    paths = subprocess.run(['git', 'ls-files', 'include/*.h', 'src/*.h', 'src/*.cpp'],
                           capture_output=True, text=True, check=True).stdout.split()
    faults = [f'{path}:{number}: {text}' for path in paths for number, text in wrong_includes(path)]
    faults += defined_twice(paths)
    faults += tests_in_no_program()
    print('\n'.join(faults) or f'layers: {len(paths)} files, no wrong arrow')
    return 1 if faults else 0


if __name__ == '__main__':
    sys.exit(main())
