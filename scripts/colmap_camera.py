#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What COLMAP (pip install pycolmap) finds of the camera of a folder of images, for comparison with a run without calibration.

Prints one JSON object: images with a pose, focal length [px], parameters of the lens, processor time [s]; writes the trajectory
(TUM format, times of times.txt or numbers of the images) of the largest model.
"""
import argparse
import json
import resource
import shutil
import sys
from pathlib import Path


def trajectory(model, times):
    """The lines of a TUM file, camera to world."""
    lines = []
    for image in sorted(model.images.values(), key=lambda image: image.name):
        if not image.has_pose:
            continue
        pose = image.cam_from_world().inverse()
        numbers = [times[image.name], *pose.translation, *pose.rotation.quat]
        lines.append(' '.join(f'{x:.9f}' for x in numbers))
    return lines


def times_of(folder, names):
    """Times by name of the image."""
    file = folder / 'times.txt'
    if not file.exists():
        return {name: float(i) for i, name in enumerate(names)}
    rows = [line.split() for line in file.read_text(encoding='utf-8').splitlines() if line.strip() and line[0] != '#']
    known = {row[0]: float(row[1]) for row in rows}
    return {name: known[Path(name).stem] for name in names}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('folder', type=Path, help='with images/ and, where there are times, times.txt')
    parser.add_argument('--every', type=int, default=1, help='use each N-th image')
    parser.add_argument('--model', default='SIMPLE_RADIAL', help="COLMAP's name of the lens model")
    parser.add_argument('--params', default='', help='of the lens to begin with')
    parser.add_argument('--principal-point', action='store_true', help='refine it, too')
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--work', type=Path, required=True, help='folder for database and trajectory.txt, emptied before')
    args = parser.parse_args()
    try:
        import pycolmap
    except ImportError:
        sys.exit('pycolmap is not installed: pip install pycolmap')
    shutil.rmtree(args.work, ignore_errors=True)
    args.work.mkdir(parents=True)
    images = args.folder / 'images'
    names = sorted(path.name for path in images.iterdir())[::args.every]
    database = args.work / 'database.db'
    reader = pycolmap.ImageReaderOptions(camera_model=args.model, camera_params=args.params)
    pycolmap.extract_features(database, images, image_names=names, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader,
                              extraction_options=pycolmap.FeatureExtractionOptions(num_threads=args.threads))
    pycolmap.match_sequential(database, matching_options=pycolmap.FeatureMatchingOptions(num_threads=args.threads))
    options = pycolmap.IncrementalPipelineOptions(num_threads=args.threads, ba_refine_principal_point=args.principal_point)
    models = pycolmap.incremental_mapping(database, images, args.work, options)
    spent = resource.getrusage(resource.RUSAGE_SELF)
    result = {'given': len(names), 'posed': 0, 'seconds': spent.ru_utime + spent.ru_stime}
    if models:
        model = max(models.values(), key=lambda found: found.num_reg_images())
        camera = next(iter(model.cameras.values()))
        (args.work / 'trajectory.txt').write_text('\n'.join(trajectory(model, times_of(args.folder, names))) + '\n', encoding='utf-8')
        result.update(posed=model.num_reg_images(), focal=camera.mean_focal_length(), params=list(camera.params),
                      error=model.compute_mean_reprojection_error())
    print(json.dumps(result))


if __name__ == '__main__':
    main()
