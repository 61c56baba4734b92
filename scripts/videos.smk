# SPDX-License-Identifier: BSD-3-Clause
# `dsorb run` over a list of videos, and one table of what each gave. What --config takes beside `videos`: `dsorb` (the
# command), `arguments` (for every run), `threads` (of each run) and `timeout` (seconds, after which it counts as failed).
import importlib.util
import os
import shlex
import sys

sys.path.insert(0, workflow.basedir)
from dsorb_eval import collection

LIST = os.path.abspath(config['videos'])
TIMEOUT = int(config.get('timeout', 3600))
THREADS = int(config.get('threads', 1))
COMMAND = f'{config.get("dsorb", "dsorb")} run'
ARGUMENTS = f'--threads {THREADS} {config.get("arguments", "")}'
VIDEOS = collection.read_list(LIST)
TABLES = ['table.csv'] + (['table.parquet'] if importlib.util.find_spec('pyarrow') else [])
STEP = f'PYTHONPATH={shlex.quote(workflow.basedir)}${{{{PYTHONPATH:+:$PYTHONPATH}}}} {shlex.quote(sys.executable)} -m dsorb_eval'


wildcard_constraints:
    name=r'[\w.+-]+',


localrules:
    table,


rule table:
    input:
        records=expand('videos/{name}/record.json', name=VIDEOS),
        logs=expand('videos/{name}/log.txt', name=VIDEOS),
        out=expand('videos/{name}/out', name=VIDEOS),
    output:
        TABLES,
    params:
        list=LIST,
    shell:
        STEP + ' table {params.list:q} {output[0]:q}'


# A video that fails is a result: its record says so. This rule fails only where a run could not be made at all.
rule video:
    output:
        record='videos/{name}/record.json',
        log='videos/{name}/log.txt',
        out=directory('videos/{name}/out'),
    params:
        list=LIST,
        command=COMMAND,
        arguments=ARGUMENTS,
    threads: max(1, THREADS)
    resources:
        mem_mb=2000,
        runtime=TIMEOUT // 60 + 5,
    shell:
        STEP + f' video {{params.list:q}} {{wildcards.name}} {{output.record}} {TIMEOUT} {{params.command:q}} {{params.arguments:q}}'
