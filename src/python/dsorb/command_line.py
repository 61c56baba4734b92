# SPDX-License-Identifier: BSD-3-Clause
"""dsorb run VIDEO|FOLDER|BAG: poses and points of a video; dsorb view DIR: the run in the Rerun viewer; dsorb export DIR:
files for other programs; dsorb calibrate VIDEO: calibration from a chessboard; dsorb merge MAP MAP: one map of two."""
import argparse
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

from . import __version__, bags, calibrate, recording
from .export import FORMATS, export
from .pictures import program, view_of_exif
from .metric import to_metres
from .run_folder import alone_in, read_run, remove_exports
from .summary import summarize

RUNTIME_ERROR, WRONG_OPTIONS, NOT_TRACKED = 1, 2, 3  # as dso_dataset has them
INTERRUPTED = 130  # as of a shell
LOOPBACK = '127.0.0.1'
TELLS = {'--version', '--print-config'}  # options of dso_dataset that it answers instead of running
FLAGS = {'--reverse', '--pipelined', '--skip-unreadable', *TELLS}  # those without a value

DESCRIPTION = '''\
Poses of the camera and points of the scene from a video, a folder of images or a ROS bag.

  dsorb run clip.mp4 --export colmap,nerfstudio
  dsorb run images/ --calib camera.yaml --output out/mine --view
  dsorb export out/mine --format colmap --undistort
  dsorb metric out/mine --distance 10 85 2.5
  dsorb calibrate board.mp4 --board 9x6 --output camera.txt'''
RUN_EPILOG = '''\
All other options are those of dso_dataset (dsorb run --help-all): --set key=value, --width, --every, --from, --to,
--mask, --initializer, ... The summary at the end names what it suspects of the camera. It cannot tell everything: a rolling
shutter of 25 ms is not seen in a smooth walk (--readout auto models one).
Exit codes: 0 tracked to the end, 1 unreadable data or failed export, 2 wrong options, 3 never initialized or lost for good.'''


def formats_of(text):
    names = [name.strip() for name in text.split(',')]
    for name in names:
        if name not in FORMATS:
            raise argparse.ArgumentTypeError(f"'{name}': expected some of {','.join(FORMATS)}")
    return list(dict.fromkeys(names))


def board_of(text):
    numbers = text.split('x')
    if len(numbers) != 2 or not all(n.isdigit() and int(n) > 2 for n in numbers):
        raise argparse.ArgumentTypeError(f"'{text}': expected COLUMNSxROWS of inner corners, 3 or more, for example 9x6")
    return tuple(map(int, numbers))


def positive(text):
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}': expected a whole number from 1")
    return int(text)


def add_calibrate(commands):
    parser = commands.add_parser('calibrate', help='calibration from a chessboard', allow_abbrev=False)
    parser.add_argument('input', help='video, or folder of images, of a flat chessboard: near and far, tilted, everywhere')
    parser.add_argument('--board', metavar='COLUMNSxROWS', type=board_of, required=True, help='inner corners, e.g. 9x6')
    parser.add_argument('--model', choices=calibrate.LENSES, default='radtan', help='equidistant: a fisheye')
    parser.add_argument('--every', metavar='N', type=positive, default=1, help='look at each N-th image')
    parser.add_argument('--output', metavar='FILE.txt', type=text_file,
                        help='default camera.txt, which must not be there yet; a picture of the residuals lies beside it')


def text_file(text):
    if Path(text).suffix != '.txt':
        raise argparse.ArgumentTypeError(f"'{text}': expected the name of a .txt, the form of DSO's camera.txt")
    return Path(text)


def run_calibrate(args):
    output = args.output or Path('camera.txt')
    try:
        if args.output is None and output.exists():
            raise ValueError(f'{output}: is there already; name it with --output where it shall be replaced')
        output.parent.mkdir(parents=True, exist_ok=True)
        found = calibrate.calibrate(args.input, args.board, args.model, args.every)
        output.write_text(found.text(), encoding='utf-8')
        calibrate.draw_residuals(found, output.with_suffix('.png'))
    except (ValueError, OSError) as error:
        print(f'dsorb: calibrate: {error}', file=sys.stderr)
        return RUNTIME_ERROR
    print(f'{calibrate.report(found)}\n{output}, {output.with_suffix(".png")}')
    return 0


def add_merge(commands):
    parser = commands.add_parser('merge', help='one map of several (dso_dataset --save-map)', allow_abbrev=False)
    parser.add_argument('maps', nargs='+', metavar='MAP', help='two or more; world and unit are those of the first that has a place')
    parser.add_argument('--output', metavar='FILE', required=True, help='the merged map')


def run_merge(args):
    named = [word for name in args.maps for word in ('--merge-map', name)]
    return subprocess.call([str(program()), *named, '--save-map', args.output])


def add_export_flags(parser):
    parser.add_argument('--all-frames', action='store_true',
                        help='models with every posed image; default: those of the keyframes')
    parser.add_argument('--undistort', action='store_true',
                        help='models of undistorted images, which are written to DIR/images')
    parser.add_argument('--refine', action='store_const', const='poses',
                        help='models after triangulation and adjustment by pycolmap, which takes some minutes')
    parser.add_argument('--refine-focal', action='store_const', const='focal', dest='refine',
                        help='the same, the focal length as well: where it is a guess')


def add_view_flags(parser, live):
    where = parser.add_mutually_exclusive_group()
    if live:
        where.add_argument('--view', action='store_true', help='show the run in the Rerun viewer while it goes on')
    where.add_argument('--serve', action='store_true', help='the same in a browser of this machine, until Ctrl-C')
    where.add_argument('--save', metavar='FILE.rrd', type=Path, help='the same into a file, for `rerun FILE.rrd`')
    parser.add_argument('--port', metavar='N', type=positive, default=9090, help='of --serve, which takes N+1, too; default 9090')
    parser.add_argument('--bind', metavar='ADDRESS', default=LOOPBACK, help=f'of --serve: who may look. Default {LOOPBACK}, this machine '
                        'alone; 0.0.0.0 is everybody who reaches it')


def distance_of(words):
    """A B METRES [SIGMA]; one per cent where no standard deviation is given."""
    try:
        first, second, metres = int(words[0]), int(words[1]), float(words[2])
        sigma = float(words[3]) if len(words) > 3 else .01 * metres
    except (ValueError, IndexError):
        first, second, metres, sigma = 0, 0, 0, 0
    if len(words) > 4 or first < 0 or second < 0 or first == second or not 0 < metres < math.inf or not 0 < sigma < math.inf:
        raise ValueError(f"--distance: '{' '.join(words)}': expected two different image numbers, metres and perhaps their standard deviation: 10 85 2.5 .02")
    return first, second, metres, sigma


def add_metric_flags(parser):
    """What tells metres. One of them."""
    known = parser.add_argument_group('metres (one of these; DIR/metric has the result)').add_mutually_exclusive_group()
    known.add_argument('--distance', nargs='+', metavar=('A B METRES', 'SIGMA'), help='between the camera at the images A and B (their numbers from 0); '
                       'standard deviation of 1 %% by default')
    known.add_argument('--speed', metavar='FILE.csv', help='lines of time [s], speed [m/s]')
    known.add_argument('--altitude', metavar='FILE.csv', help='lines of time [s], altitude [m]')
    known.add_argument('--gps', metavar='FILE.csv|FILE.gpx', help='lines of time [s], latitude, longitude [degrees], altitude [m]; or a GPX track')
    parser.add_argument('--time-offset', metavar='SECONDS', type=float, default=0, help='added to the times of that file, to be those of the images')


def write_metric(args):
    """@return exit code"""
    try:
        knowledge = {'distance': distance_of(args.distance) if args.distance else None, 'speed': args.speed, 'altitude': args.altitude,
                     'gps': args.gps, 'time_offset': args.time_offset}
    except ValueError as error:
        print(f'dsorb: {error}', file=sys.stderr)
        return WRONG_OPTIONS
    if not any(knowledge[kind] for kind in ('distance', 'speed', 'altitude', 'gps')):
        print('dsorb: metric: expected --distance, --speed, --altitude or --gps', file=sys.stderr)
        return WRONG_OPTIONS
    try:
        print('\n'.join(to_metres(args.folder, knowledge)))
    except (ValueError, OSError) as error:
        why = f'{error.filename}: {error.strerror}' if isinstance(error, OSError) and error.filename else error
        print(f'dsorb: metric: {why}', file=sys.stderr)
        return RUNTIME_ERROR
    return 0


def add_run(commands):
    run = commands.add_parser('run', help='poses and points of a video', epilog=RUN_EPILOG, allow_abbrev=False,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument('input', nargs='?', help='video file, folder or .zip of images, data set, ROS bag or MCAP file, '
                     '/dev/videoN, rtsp://...')
    run.add_argument('--topic', metavar='NAME', help='images of a bag; needed where it has several topics of images')
    run.add_argument('--calib', metavar='FILE', help='calibration of the camera, in any form of docs/calibration.md')
    run.add_argument('--hfov', metavar='DEGREES|exif', help='what the images show from left to right, about, without a calibration; '
                     'exif: by the focal length that photographs note; default: found out')
    run.add_argument('--output', metavar='DIR', type=Path, help='default out/<name of the input>')
    run.add_argument('--export', metavar='FORMATS', type=formats_of, default=[], help=','.join(FORMATS))
    add_view_flags(run, live=True)
    run.add_argument('--record', metavar='FILE', type=Path, help='what a view is made from; default with one: DIR/recording.jsonl')
    run.add_argument('--quiet', action='store_true', help='print errors only')
    run.add_argument('--help-all', action='store_true', help='the options of dso_dataset')
    add_export_flags(run)
    return run


def add_view(commands):
    view = commands.add_parser('view', help='a run in the Rerun viewer', allow_abbrev=False)
    view.add_argument('folder', metavar='DIR', help='output folder of a run with a recording in it, or the recording itself')
    add_view_flags(view, live=False)
    view.add_argument('--follow', action='store_true', help='go on with what a running program appends, until nothing came for a minute')
    view.add_argument('--max-sigma', type=float, default=0.3, metavar='X', help='points whose inverse depth is less certain than '
                      'this share of it are left out; default 0.3')


def sorted_out(words, run):
    """Words of `dsorb run` with the options of dso_dataset at the end: argparse does not know which of them have a value, and
    would take one that stands before the input for the input."""
    ours, theirs, known, left = [], [], re.findall(r'--[a-z-]+', run.format_usage()), iter(words)
    for word in left:
        if not word.startswith('--') or word.partition('=')[0] in known:
            ours.append(word)
            continue
        theirs.append(word)
        if '=' not in word and word not in FLAGS:
            theirs += [value for value in [next(left, None)] if value is not None]
    return ours + theirs


def parse(words):
    parser = argparse.ArgumentParser('dsorb', description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     allow_abbrev=False)
    parser.add_argument('--version', action='version', version=f'dsorb {__version__}')
    commands = parser.add_subparsers(dest='command', required=True)
    run = add_run(commands)
    add_view(commands)
    later = commands.add_parser('export', help='files for other programs from an output folder', allow_abbrev=False)
    later.add_argument('folder', metavar='DIR', type=Path, help='output folder of dsorb run or dso_dataset')
    later.add_argument('--format', metavar='FORMATS', type=formats_of, required=True, help=','.join(FORMATS))
    add_export_flags(later)
    metric = commands.add_parser('metric', help='metres from a distance, speeds, altitudes or a GPS track', allow_abbrev=False)
    metric.add_argument('folder', metavar='DIR', type=Path, help='output folder of dsorb run or dso_dataset')
    add_metric_flags(metric)
    add_calibrate(commands)
    add_merge(commands)
    words = sys.argv[1:] if words is None else list(words)
    if words[:1] == ['run']:
        words = words[:1] + sorted_out(words[1:], run)
    args, rest = parser.parse_known_args(words)
    if args.command != 'run' and rest:
        parser.error(f'unrecognized arguments: {" ".join(rest)}')
    if args.command == 'run' and args.input is None and not args.help_all and not TELLS & set(rest):
        run.error('no video and no folder of images given')
    if args.command == 'run' and not args.export and (args.all_frames or args.undistort or args.refine):
        run.error('--all-frames, --undistort and --refine are expected beside --export')
    return args, rest


def default_output(source):
    path = Path(source).resolve()
    return Path('out') / (path.stem if path.is_file() else path.name)


def run_program(words):
    """Runs dso_dataset until it ends by itself; Ctrl-C is its to answer. @return its exit code"""
    with subprocess.Popen([str(program()), *words], stdout=subprocess.DEVNULL) as process:
        asked = {number: signal.signal(number, lambda *_: None) for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, 'SIGHUP', signal.SIGTERM))
                 if signal.getsignal(number) != signal.SIG_IGN}  # as nohup has it
        for number in asked.keys() - {signal.SIGINT}:
            signal.signal(number, lambda *_: process.terminate())
        try:
            return process.wait()
        finally:
            for number, handler in asked.items():
                signal.signal(number, handler)


def seconds_in(words, flag, otherwise):
    """Value of an option of dso_dataset, which complains itself of one that is no number."""
    values = [word.partition('=')[2] for word in words if word.startswith(f'{flag}=')]
    values += [value for word, value in zip(words, words[1:]) if word == flag]
    try:
        return float(values[-1])
    except (IndexError, ValueError):
        return otherwise


def take_from_bag(args, rest, output):
    """Has the images of a bag as the input, and its calibration where none was given. @return exit code"""
    if not bags.is_bag(args.input):
        if args.topic is not None:
            print(f'dsorb: --topic: {args.input} is no bag (.bag, .mcap, .db3, or a folder with such files)', file=sys.stderr)
        return WRONG_OPTIONS if args.topic is not None else 0
    try:
        with alone_in(output):
            found = bags.unpack(args.input, args.topic, output / 'bag_images', seconds_in(rest, '--from', 0),
                                seconds_in(rest, '--to', 0) or math.inf)
    except (ValueError, OSError) as error:
        print(f'dsorb: {error}', file=sys.stderr)
        return WRONG_OPTIONS if isinstance(error, bags.TopicError) else RUNTIME_ERROR
    source, args.input = args.input, str(found.folder)
    if args.calib is None and args.hfov is None:
        args.calib = found.calibration and str(found.calibration)
        if args.calib is None and not args.quiet:
            print(f'dsorb: {source}: {found.no_calibration}; the camera is found out', file=sys.stderr)
    elif args.calib is not None and not any(word.partition('=')[0] == '--camera' for word in rest):
        rest += ['--camera', found.topic]  # tells which one of several
    if not args.quiet:
        for note in found.notes:
            print(f'dsorb: warning: {found.topic}: {note}', file=sys.stderr)
        print(f'{found.topic}: {found.images} images' + (f', {found.left_out} left out that repeat a time' if found.left_out else '')
              + (', calibration from camera_info' if args.calib == str(found.calibration) else ''))
    return 0


def open_window(args, name):
    """Where the run is shown. Raises ValueError or OSError saying why it cannot be."""
    try:
        from . import rerun_view
    except ImportError:
        raise ValueError('--view, --serve and --save need the package rerun-sdk: pip install rerun-sdk') from None
    window = rerun_view.Window(name, args.save, args.port if args.serve else None, args.bind)
    if window.address and not getattr(args, 'quiet', False):
        others = 'seen on this machine alone; --bind 0.0.0.0 lets others look' if args.bind == LOOPBACK else \
            'from elsewhere: the name of this machine in place of localhost, twice; whoever reaches it may look'
        print(f'{window.address}  ({others})', flush=True)
    return window


def serve_on(window, args):
    """After the end: a browser may come later."""
    if args.serve:
        print('still there to be looked at; Ctrl-C ends it', flush=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            pass
    window.close()


def view(args):
    """@return exit code"""
    try:
        path = recording.find(args.folder)
        window = open_window(args, str(path.resolve()))
        images = window.play(path, recording.patient() if args.follow else None, args.max_sigma)
    except (ValueError, OSError) as error:
        print(f'dsorb: view: {error}', file=sys.stderr)
        return RUNTIME_ERROR
    except KeyboardInterrupt:
        return INTERRUPTED
    print(f'{images} images' + (f'; {args.save}' if args.save else ''), flush=True)
    serve_on(window, args)
    return 0


def words_of(args, rest, output):
    """Arguments of dso_dataset. Raises ValueError or OSError where photographs note no focal length."""
    if args.hfov == 'exif':
        try:
            args.hfov = f'{view_of_exif(args.input):.3f}'
        except ValueError as error:
            raise ValueError(f'--hfov exif: {error}') from None
    words = [args.input, '--output', str(output), *rest]
    for flag, value in (('--calib', args.calib), ('--hfov', args.hfov), ('--record', args.record)):
        words += [flag, str(value)] if value is not None else []
    return words + (['--quiet'] if args.quiet else [])


def was_cut_short(output):
    """Whether a run that ended with an error left images before it: of a video that is cut off, a camera that went away."""
    try:
        summary = json.loads((output / 'run.json').read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return False
    return summary['status'] == 'error' and summary['frames_given'] > 0


def wrong_options(words):
    """Whether the program refuses them, before anything of an earlier run is touched. @return its exit code"""
    return subprocess.run([str(program()), *words, '--print-config'], stdout=subprocess.DEVNULL, check=False).returncode


def run(args, rest):
    output = args.output or default_output(args.input)
    shown = args.view or args.serve or args.save
    if shown and args.record is None:
        args.record = output / 'recording.jsonl'
    try:
        code = wrong_options(words_of(args, rest, output)) if shown or bags.is_bag(args.input) else 0
        code = code or take_from_bag(args, rest, output)
        if code:
            return code
        words = words_of(args, rest, output)
        window = open_window(args, str(output.resolve())) if shown else None
    except (ValueError, OSError) as error:
        print(f'dsorb: {error}', file=sys.stderr)
        return RUNTIME_ERROR
    earlier = recording.change_time(output / 'run.json')
    code = run_shown(words, window, args.record) if window else run_program(words)
    written = recording.change_time(output / 'run.json') != earlier
    if written:
        remove_exports(output)
    if code < 0 or code == WRONG_OPTIONS or (code == RUNTIME_ERROR and not (written and was_cut_short(output))):
        return code if code > 0 else RUNTIME_ERROR
    if not args.quiet:
        tell(output)
    code = code if write_exports(output, args.export, args) else RUNTIME_ERROR
    if window:
        serve_on(window, args)
    return code


def tell(output):
    """The summary of a run."""
    try:
        print(summarize(read_run(output)), flush=True)
    except (ValueError, OSError) as error:
        print(f'dsorb: {error}', file=sys.stderr)


def run_shown(words, window, record):
    """The program, with what it records in a viewer. @return its exit code"""
    from .rerun_view import Live
    live = Live(window, record)
    try:
        return run_program(words)
    finally:
        error = live.end()
        if error:
            print(f'dsorb: the view ended early: {error}', file=sys.stderr)


def write_exports(folder, formats, args):
    """@return whether everything could be written"""
    if not formats:
        return True
    try:
        notes = export(folder, formats, args.all_frames, args.undistort, args.refine)
    except (ValueError, OSError) as error:
        print(f'dsorb: export: {error}', file=sys.stderr)
        return False
    if not getattr(args, 'quiet', False):
        print('\n'.join(notes))
    return True


def main(words=None):
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='surrogateescape')  # names of files are bytes
    args, rest = parse(words)
    if args.command == 'calibrate':
        sys.exit(run_calibrate(args))
    if args.command == 'merge':
        sys.exit(run_merge(args))
    if args.command == 'view':
        sys.exit(view(args))
    if args.command == 'metric':
        sys.exit(write_metric(args))
    if args.command == 'export':
        sys.exit(0 if write_exports(args.folder, args.format, args) else RUNTIME_ERROR)
    if not os.access(program(), os.X_OK):
        sys.exit(f'dsorb: {program()}: not there; this package was built without the component `programs`')
    if args.help_all or TELLS & set(rest):
        told = ['--help'] if args.help_all else [args.input] * (args.input is not None) + rest
        sys.exit(subprocess.run([str(program()), *told], check=False).returncode)
    try:
        sys.exit(run(args, rest))
    except KeyboardInterrupt:  # before the program ran, which answers it itself
        sys.exit(INTERRUPTED)


if __name__ == '__main__':
    main()
