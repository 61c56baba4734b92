# SPDX-License-Identifier: BSD-3-Clause
"""download_data.py against a file server on this machine."""
import hashlib
import http.server
import io
import os
import subprocess
import sys
import tarfile
import tempfile
import threading
import unittest
import zipfile
from pathlib import Path

import yaml

from dsorb_eval import download

SCRIPTS = Path(__file__).resolve().parents[2] / 'scripts'


class Handler(http.server.BaseHTTPRequestHandler):
    """Serves server.files; understands Range; cuts an answer short where server.cut says so."""

    def do_GET(self):
        name, server = self.path.lstrip('/'), self.server
        server.asked.append((name, self.headers.get('Range')))
        data = server.files.get(name)
        if data is None:
            self.send_error(404)
            return
        begin = int(self.headers['Range'][6:-1]) if self.headers.get('Range') and server.ranges else 0
        if begin >= len(data):
            self.send_error(416)
            return
        self.send_response(206 if begin else 200)
        self.send_header('Content-Length', str(len(data) - begin))
        self.end_headers()
        cut = server.cut.pop(name, None)
        self.wfile.write(data[begin:cut])

    def log_message(self, *_):
        pass


def zip_of(**files):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, 'w') as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return stream.getvalue()


class Download(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix='dsorb_download_')
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)
        self.server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
        self.server.files, self.server.asked, self.server.cut, self.server.ranges = {}, [], {}, True
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.addCleanup(self.server.server_close)
        self.addCleanup(self.server.shutdown)

    def url(self, name):
        return f'http://127.0.0.1:{self.server.server_port}/{name}'

    def fetch(self, name, **more):
        return download.fetch(self.url(name), self.folder / name, pause=0, **more)

    def test_a_broken_connection_is_resumed(self):
        data = os.urandom(100000)
        self.server.files['a.bin'], self.server.cut['a.bin'] = data, 40000
        self.assertEqual(self.fetch('a.bin'), hashlib.sha256(data).hexdigest())
        self.assertEqual((self.folder / 'a.bin').read_bytes(), data)
        self.assertEqual(self.server.asked, [('a.bin', None), ('a.bin', 'bytes=40000-')])

    def test_a_server_that_cannot_resume_sends_all_again(self):
        data = os.urandom(5000)
        self.server.files['a.bin'], self.server.ranges = data, False
        (self.folder / 'a.bin.part').write_bytes(b'old' * 100)
        self.fetch('a.bin')
        self.assertEqual((self.folder / 'a.bin').read_bytes(), data)

    def test_a_finished_part_is_taken(self):
        self.server.files['a.bin'] = b'0123456789'
        (self.folder / 'a.bin.part').write_bytes(b'0123456789')
        self.fetch('a.bin')
        self.assertEqual((self.folder / 'a.bin').read_bytes(), b'0123456789')

    def test_a_wrong_sum_leaves_nothing(self):
        self.server.files['a.bin'] = b'tampered'
        with self.assertRaisesRegex(download.DownloadError, 'expected 0000'):
            self.fetch('a.bin', digest='0' * 64)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_missing_file_is_said_at_once(self):
        with self.assertRaisesRegex(download.DownloadError, 'gone.zip: HTTP Error 404'):
            self.fetch('gone.zip')
        self.assertEqual(len(self.server.asked), 1)

    def test_members_outside_of_the_archive_are_refused(self):
        archive = self.folder / 'bad.zip'
        archive.write_bytes(zip_of(**{'../evil.txt': 'x'}))
        with self.assertRaisesRegex(download.DownloadError, 'points out of the archive'):
            download.unpack(archive, 'zip', self.folder / 'into')
        with tarfile.open(self.folder / 'bad.tgz', 'w:gz') as file:
            link = tarfile.TarInfo('link')
            link.type, link.linkname = tarfile.SYMTYPE, '/etc'
            file.addfile(link)
        with self.assertRaisesRegex(download.DownloadError, 'something else than files'):
            download.unpack(self.folder / 'bad.tgz', 'tgz', self.folder / 'into')

    def catalogue(self):
        stream = io.BytesIO()
        with tarfile.open(fileobj=stream, mode='w:gz') as file:
            info = tarfile.TarInfo('desk/rgb.txt')
            info.size = 4
            file.addfile(info, io.BytesIO(b'1 a\n'))
        self.server.files.update({'one.zip': zip_of(**{'mav0/cam0/data.csv': '#\n'}), 'desk.tgz': stream.getvalue()})
        path = self.folder / 'catalogue.yaml'
        path.write_text(yaml.safe_dump(dict(
            small=dict(page='p', licence='free', about='a', files=dict(
                one=dict(url=self.url('one.zip'), into='small/one', unpack='zip'),
                desk=dict(url=self.url('desk.tgz'), into='small', unpack='tgz')),
                write={'small/desk/camera.txt': 'Pinhole 1 1 1 1 0\n'},
                sequences=[dict(name='one', path='small/one'), dict(name='desk', path='small/desk')]),
            walled=dict(page='https://example.org', licence='ask', about='b', manual='Register, unpack into {folder}/walled.\n'))))
        return path

    def program(self, *words):
        command = [sys.executable, SCRIPTS / 'download_data.py', '--to', self.folder / 'to', '--catalogue', self.folder / 'catalogue.yaml']
        return subprocess.run([*command, *words], capture_output=True, text=True, env=dict(os.environ, DSORB_VENV=sys.prefix))

    def test_the_program_from_address_to_sequences_file(self):
        self.catalogue()
        first = self.program('small/one')
        self.assertEqual(first.returncode, 0, first.stderr)
        self.assertTrue((self.folder / 'to/small/one/mav0/cam0/data.csv').exists())
        self.assertFalse((self.folder / 'to/small/desk').exists())
        second = self.program('small')
        self.assertIn('one: was there already', second.stdout)
        self.assertEqual([name for name, _ in self.server.asked], ['one.zip', 'desk.tgz'])
        self.assertEqual((self.folder / 'to/small/desk/camera.txt').read_text(), 'Pinhole 1 1 1 1 0\n')
        listed = yaml.safe_load((self.folder / 'to/sequences.yaml').read_text())['sequences']
        self.assertEqual([entry['name'] for entry in listed], ['one', 'desk'])
        self.assertEqual(len((self.folder / 'to' / download.SUMS).read_text().splitlines()), 2)
        by_hand = self.program('walled')
        self.assertEqual(by_hand.returncode, 0)
        self.assertIn(f"unpack into {self.folder / 'to'}/walled", by_hand.stdout)
        unknown = self.program('smal')
        self.assertEqual(unknown.returncode, 1)
        self.assertIn('smal: unknown; known: small, walled', unknown.stderr)

    def test_our_own_catalogue_is_complete(self):
        catalogue = download.read_catalogue(SCRIPTS / 'datasets.yaml')
        for name, entry in catalogue.items():
            for file in entry.get('files', {}).values():
                self.assertRegex(file['url'], r'^https?://\S+\.(zip|tgz)$', name)
                self.assertIn(file['unpack'], ('zip', 'tgz'))
        names = [s['name'] for entry in catalogue.values() for s in entry.get('sequences', [])]
        self.assertEqual(len(names), len(set(names)))


if __name__ == '__main__':
    unittest.main()
