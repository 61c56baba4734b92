# SPDX-License-Identifier: BSD-3-Clause
"""Fetching public data sets: resumable, checked, unpacked only once complete."""
import hashlib
import shutil
import tarfile
import time
import urllib.error
import urllib.request
import zipfile
from pathlib import Path

import yaml

from .trajectory import FormatError

BLOCK = 1 << 20
TIMEOUT = 60  # [s] without a single byte
TRIES = 3
SUMS = 'SHA256SUMS'
UNPACKED = '.unpacked'


class DownloadError(RuntimeError):
    """What could not be fetched, and why; the message names address or file."""


def read_catalogue(path):
    """Data sets by name. @throws FormatError"""
    content = yaml.safe_load(Path(path).read_text())
    for name, entry in content.items():
        missing = {'page', 'licence', 'about'} - set(entry)
        if missing or ('files' in entry) == ('manual' in entry):
            raise FormatError(f'{path}: {name}: expected page, licence, about, and either files or manual')
    return content


def sha256_of(path):
    digest = hashlib.sha256()
    with open(path, 'rb') as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def read_sums(folder):
    """Sums of earlier downloads: file name -> SHA-256."""
    path = folder / SUMS
    lines = path.read_text().splitlines() if path.exists() else []
    return {name: digest for digest, name in (line.split('  ', 1) for line in lines)}


def keep_sum(folder, name, digest):
    sums = {**read_sums(folder), name: digest}
    (folder / SUMS).write_text(''.join(f'{d}  {n}\n' for n, d in sorted(sums.items())))


def receive(url, part, progress):
    """One attempt: appends to what is there already, where the server can go on in the middle.

    @param progress  called with (bytes so far, bytes in all or None)"""
    have = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(url, headers={'Range': f'bytes={have}-'} if have else {})
    try:
        answer = urllib.request.urlopen(request, timeout=TIMEOUT)
    except urllib.error.HTTPError as error:
        if error.code == 416 and have:  # nothing beyond what is there
            return
        raise
    with answer:
        if have and answer.status != 206:
            have = 0  # it sends everything again
        length = answer.headers.get('Content-Length')
        total = have + int(length) if length else None
        with open(part, 'ab' if have else 'wb') as file:
            while block := answer.read(BLOCK):
                file.write(block)
                have += len(block)
                progress(have, total)
    if total is not None and have != total:
        raise OSError(f'{have} of {total} bytes came')


def fetch(url, target, digest=None, progress=lambda have, total: None, pause=2.):
    """Downloads a file, going on where an earlier attempt stopped, and checks its sum.

    @param digest  SHA-256 it must have; None: any
    @throws DownloadError"""
    part = target.with_name(target.name + '.part')
    target.parent.mkdir(parents=True, exist_ok=True)
    for attempt in range(TRIES):
        try:
            receive(url, part, progress)
            break
        except (OSError, urllib.error.URLError) as error:
            if isinstance(error, urllib.error.HTTPError) and 400 <= error.code < 500 or attempt + 1 == TRIES:
                raise DownloadError(f'{url}: {error}') from None
            time.sleep(pause)
    found = sha256_of(part)
    if digest and found != digest:
        part.unlink()
        raise DownloadError(f'{url}: SHA-256 {found}, expected {digest}; the file was removed')
    part.replace(target)
    return found


def checked_members(names, into, archive):
    """@throws DownloadError where a member would land outside of the folder"""
    for name in names:
        if not (into / name).resolve().is_relative_to(into.resolve()):
            raise DownloadError(f'{archive}: {name!r} points out of the archive')


def unpack(archive, kind, into):
    """Unpacks a zip or tgz into a folder. Links in archives are refused."""
    into.mkdir(parents=True, exist_ok=True)
    if kind == 'zip':
        with zipfile.ZipFile(archive) as file:
            checked_members(file.namelist(), into, archive)
            file.extractall(into)
        return
    with tarfile.open(archive) as file:
        members = file.getmembers()
        checked_members([member.name for member in members], into, archive)
        if not all(member.isfile() or member.isdir() for member in members):
            raise DownloadError(f'{archive}: holds something else than files and folders')
        for member in members:
            if member.isdir():
                (into / member.name).mkdir(parents=True, exist_ok=True)
                continue
            (into / member.name).parent.mkdir(parents=True, exist_ok=True)
            with file.extractfile(member) as source, open(into / member.name, 'wb') as target:
                shutil.copyfileobj(source, target)


def get_file(name, entry, folder, progress, keep_archives):
    """One file of a data set: downloaded, checked and unpacked unless that was done before. @return whether anything was done"""
    archive = folder / 'archives' / entry['url'].rsplit('/', 1)[-1]
    mark = folder / 'archives' / f'{archive.name}{UNPACKED}'
    if mark.exists():
        return False
    known = entry.get('sha256') or read_sums(folder).get(archive.name)
    if not archive.exists():
        keep_sum(folder, archive.name, fetch(entry['url'], archive, known, progress))
    elif known and sha256_of(archive) != known:
        raise DownloadError(f'{archive}: its SHA-256 is not {known}; remove it to fetch it again')
    try:
        unpack(archive, entry['unpack'], folder / entry['into'])
    except (zipfile.BadZipFile, tarfile.TarError, EOFError) as error:
        raise DownloadError(f'{name}: {archive} cannot be unpacked: {error}') from None
    mark.touch()
    if not keep_archives:
        archive.unlink()
    return True


def write_sequences(catalogue, folder):
    """sequences.yaml for scripts/evaluate.py: every sequence of the catalogue that is there. @return its path and the names"""
    found = [sequence for entry in catalogue.values() for sequence in entry.get('sequences', []) if (folder / sequence['path']).is_dir()]
    path = folder / 'sequences.yaml'
    path.write_text(yaml.safe_dump(dict(sequences=found), sort_keys=False))
    return path, [sequence['name'] for sequence in found]
