# SPDX-License-Identifier: BSD-3-Clause
"""Evaluation of dso_dataset: many runs against ground truth, summed up in tables, figures and one HTML page.

trajectory  poses, ground truth files, alignment          store     the output folder: plan, records, figures of runs
metrics     equations 15-19 of [Gladkova] and more        summary   rows of the tables, CSV and Markdown
layout      times, ground truth and depth of data sets    plots     cumulative plots
protocol    sequences file, start frames, list of runs    pictures  overlays side by side, residual histogram
runner      one run of the program                        report    report.html
judge       output folder of a run -> figures             cli       what scripts/evaluate.py does
evo         evo's programs, called from outside           start_pictures  residuals, epipolar search of one start
package     the Python package, of a build or installed
download    for download_data.py                         collection  `dsorb run` over a list of videos
"""
