# SPDX-License-Identifier: BSD-3-Clause
"""Python objects in wrong hands: threads, forks, the end of the interpreter, values that are none."""
import gc
import itertools
import math
import multiprocessing
import os
import signal
import threading
import time

import dsorb
import numpy as np
from attack import case, main
from room import SIZE, images

CASES = {}
CAMERA = dsorb.Camera(200, 200, 159.5, 119.5, *SIZE)


def fed(odometry, pictures, begin=0):
    """Goes on after a loss. @return its last estimate"""
    for i, image in enumerate(pictures, begin):
        estimate = odometry.process(image, .1 * i)
        if estimate.state == 'lost':
            odometry.restart()
    return estimate


def refused(call, *arguments):
    """The exception that a call raises, which names what is wrong."""
    try:
        call(*arguments)
    except (ValueError, TypeError, RuntimeError, OverflowError) as error:
        assert len(str(error)) > 10, repr(error)
        return error
    raise AssertionError(f'{arguments} were taken')


@case(CASES)
def values_that_are_none():
    image = images()[0]
    odometry = dsorb.Odometry(CAMERA, num_threads=1)
    for array in (image.astype(float), image.T, image[:0], image[:, ::-1], np.dstack([image] * 3), None, 'image', image.tolist(),
                  np.ma.masked_array(image, image > 9), image.astype('>f4'), image.astype('M8[s]'), np.array(3, np.uint8)):
        refused(odometry.process, array, 0.)
    for time_ in (math.nan, math.inf, None, 'now', 10**400):
        refused(odometry.process, image, time_)
    for number in (-1, 2**31, 1.5, 'one'):
        refused(odometry.process, image, 0., number)
    for exposure in (0, -1, math.nan, math.inf):
        refused(odometry.process, image, 0., None, exposure)
    assert odometry.process(image, 0.).id == 0


@case(CASES)
def pixels_that_are_none():
    rng = np.random.default_rng(0)
    for value, share in itertools.product((np.nan, np.inf, -np.inf, 3e38, -1e9), (.01, .5, 1)):
        odometry = dsorb.Odometry(CAMERA, num_threads=1)
        for i, image in enumerate(images()):
            wild = image.astype(np.float32)
            wild[rng.random(wild.shape) < (share if i > 12 else 0)] = value
            estimate = odometry.process(wild, .1 * i)
            assert estimate.T_world_cam is None or np.isfinite(estimate.T_world_cam).all()
            if estimate.state == 'lost':
                odometry.restart()


@case(CASES)
def one_odometry_in_eight_threads():
    odometry, pictures, place, lock = dsorb.Odometry(CAMERA, num_threads=2), images(), itertools.count(), threading.Lock()

    def work():
        while (i := next(place)) < 300:
            try:
                odometry.process(pictures[i % len(pictures)], .1 * i)
                if i % 13 == 0:
                    odometry.restart()
            except (ValueError, RuntimeError):  # another one was faster
                pass

    with lock:
        threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    odometry.finish()


@case(CASES)
def a_rectifier_in_four_threads():
    calibration = dsorb.Calibration(200, 200, 159.5, 119.5, *SIZE, 'radtan', [-.2, .05, 0, 0])
    rectifier, pictures, wrong, done = dsorb.Rectifier(calibration), images(), [], threading.Event()
    expected = [rectifier.rectify(image) for image in pictures]

    def work():
        for _ in range(20):
            wrong.extend(i for i, image in enumerate(pictures) if not np.array_equal(rectifier.rectify(image), expected[i], equal_nan=True))

    def change():
        while not done.is_set():
            rectifier.set_mask(np.ones((SIZE[1], SIZE[0]), bool))
            rectifier.set_mask(None)

    threads = [threading.Thread(target=work) for _ in range(4)]
    threading.Thread(target=change, daemon=True).start()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    done.set()
    assert not wrong, f'{len(wrong)} wrong images'


def in_child(work):
    """What a process that is forked from this one sends; it has a minute."""
    context = multiprocessing.get_context('fork')
    queue = context.Queue()
    child = context.Process(target=lambda: queue.put(work()))
    child.start()
    told = queue.get(timeout=60)
    child.join(60)
    assert child.exitcode == 0, child.exitcode
    return told


@case(CASES)
def forks():
    pictures = images()
    for pipelined in (False, True):
        odometry = dsorb.Odometry(CAMERA, num_threads=2, pipelined=pipelined)
        fed(odometry, pictures[:30])
        assert in_child(lambda: fed(dsorb.Odometry(CAMERA, num_threads=2, pipelined=pipelined), pictures).state) == 'tracked'
        if pipelined:
            assert 'fork' in in_child(lambda: str(refused(odometry.process, pictures[30], 3.)))
        else:
            assert in_child(lambda: fed(odometry, pictures[30:], 30).state) == 'tracked'
        assert fed(odometry, pictures[30:], 30).state == 'tracked'


@case(CASES)
def the_end_of_the_interpreter():
    for pipelined in (False, True):
        odometry = dsorb.Odometry(CAMERA, num_threads=2, pipelined=pipelined)
        threading.Thread(target=fed, args=[odometry, itertools.cycle(images())], daemon=True).start()
    time.sleep(1)


@case(CASES)
def signals_in_a_call():
    odometry, pictures, caught = dsorb.Odometry(CAMERA, num_threads=1), images(), 0
    for i in range(600):
        try:
            if i % 20 == 0:
                threading.Timer(.003, os.kill, [os.getpid(), signal.SIGINT]).start()
            if odometry.process(pictures[i % len(pictures)], .1 * i).state == 'lost':
                odometry.restart()
        except KeyboardInterrupt:
            caught += 1
        except ValueError:  # the frame had been taken
            pass
    assert caught > 0


@case(CASES)
def arrays_outlive_their_makers():
    odometry, kept = dsorb.Odometry(CAMERA, num_threads=1), []
    for i, image in enumerate(images()):
        estimate = odometry.process(image.copy(), .1 * i)
        for keyframe in estimate.keyframes:
            kept += [keyframe.pixels, keyframe.inverse_depths, keyframe.variances, keyframe.intensities, keyframe.world_points()]
        del estimate
    del odometry
    gc.collect()
    junk = [np.full(1000, i) for i in range(20000)]
    assert all(np.isfinite(array).sum() > 0 for array in kept if len(array)) and junk


@case(CASES)
def options_that_are_none():
    endless, deep = {}, {}
    endless['window'] = inner = deep
    for _ in range(100000):
        inner['window'] = inner = {}
    loop = {}
    loop['window'] = loop
    for options in (endless, loop, {'window': 3}, {3: 4}, {'': ''}, {'window.max_keyframes': math.nan}):
        refused(lambda: dsorb.Odometry(CAMERA, options=options))  # pylint: disable=cell-var-from-loop


if __name__ == '__main__':
    main(CASES)
