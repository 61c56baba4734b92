# SPDX-License-Identifier: BSD-3-Clause
"""The page of dsorb run --serve in a browser without a window."""
import importlib.util
import io
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import unittest
import urllib.request

import numpy as np
from PIL import Image
from room import room, temporary_folder

for package in ('rerun', 'selenium'):
    if not importlib.util.find_spec(package):
        raise unittest.SkipTest(f'the package {package} is not installed')
BROWSER, DRIVER = shutil.which('chromium'), shutil.which('chromedriver')
if not (BROWSER and DRIVER):
    raise unittest.SkipTest('chromium or chromium-driver is not installed')
from selenium import webdriver  # noqa: E402


def page_in_a_browser(address, seconds):
    """What a browser without a window shows of a page, as soon as a twentieth of it is neither black nor white nor coloured, as
    images of grey cameras are; what it shows in the end where that does not come."""
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in ('--headless=new', '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--window-size=1000,700'):
        options.add_argument(flag)
    end = time.monotonic() + seconds
    with webdriver.Chrome(options, webdriver.ChromeService(DRIVER)) as chromium:
        chromium.get(address)
        while True:
            page = np.asarray(Image.open(io.BytesIO(chromium.get_screenshot_as_png())).convert('RGB')).astype(int)
            if grey_share(page) > .05 or time.monotonic() > end:
                return page
            time.sleep(1)


def grey_share(page):
    """Share of the pixels that are grey, neither dark nor bright."""
    return np.mean((np.ptp(page, axis=2) == 0) & (page[..., 0] > 30) & (page[..., 0] < 225))


class Browser(unittest.TestCase):
    def test_a_browser_may_look_after_the_run(self):
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            port = min(free.getsockname()[1], 65000)
        output = temporary_folder() / 'out'
        with subprocess.Popen([sys.executable, '-m', 'dsorb.command_line', 'run', room(), '--output', output, '--end', '20', '--serve',
                               '--port', str(port)], stdout=subprocess.PIPE, text=True) as process:
            lines = iter(process.stdout.readline, '')
            address = re.search(r'http://localhost:\S+', next(lines))[0]
            self.assertIn(f'http://localhost:{port}/', address)
            self.assertTrue(any('Ctrl-C ends it' in line for line in lines))
            self.assertGreater(grey_share(page_in_a_browser(address, 240)), .05)  # measured .14 on another room; a page that loads has 0
            with urllib.request.urlopen(f'http://localhost:{port}/', timeout=30) as page:
                self.assertIn(b'rerun', page.read().lower())
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(30), 0)


if __name__ == '__main__':
    unittest.main()
