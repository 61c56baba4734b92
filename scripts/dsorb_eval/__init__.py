# SPDX-License-Identifier: BSD-3-Clause
"""Evaluation of dso_dataset: many runs against ground truth, summed up in tables, figures and one HTML page.

trajectory  poses, ground truth files, alignment          summary  rows of the tables, CSV and Markdown
metrics     the report's equations 15-19 and their kin    plots    cumulative plots, histogram, bars
layout      how many images a data set has                pictures overlays of a run side by side
protocol    sequences file, start frames, list of runs    report   report.html
runner      one run of the program                        evo      evo's programs, called from outside
judge       output folder of a run -> figures             cli      what scripts/evaluate.py does
"""
