# SPDX-License-Identifier: BSD-3-Clause
# The runs of an evaluation; steps know nothing but the files that their rules name.
import json
import os
import shlex
import sys

with open(os.path.join(config.get('folder', ''), 'plan.json')) as file:
    PLAN = json.load(file)
KEYS = [run['key'] for run in PLAN['runs']]
STEP = f'PYTHONPATH={shlex.quote(PLAN["scripts"])} {shlex.quote(sys.executable)} -m dsorb_eval'


wildcard_constraints:
    key=r'[\w.+-]+/[\w.+-]+/[\w.+-]+',


localrules:
    report,


rule report:
    input:
        plan='plan.json',
        records=expand('runs/{key}/record.json', key=KEYS),
        figures=expand('runs/{key}/figures.json', key=KEYS),
        out=expand('runs/{key}/out', key=KEYS),
    output:
        'report.html',
        'summary.csv',
        'summary.md',
        'failed.txt',
        directory('figures'),
        directory('tables'),
    shell:
        STEP + ' report {input.plan}'


# A run that fails is a result: its record says so. This rule fails only where a run could not be made at all.
rule run:
    input:
        plan=ancient('plan.json'),
    output:
        record='runs/{key}/record.json',
        figures='runs/{key}/figures.json',
        log='runs/{key}/log.txt',
        out=directory('runs/{key}/out'),
    threads: max(1, PLAN['threads'])
    resources:
        mem_mb=2000,
        runtime=PLAN['timeout'] // 60 + 5,
    shell:
        STEP + ' run {input.plan} {wildcards.key} {output.record}'
