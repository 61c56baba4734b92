# SPDX-License-Identifier: BSD-3-Clause
"""report.html: everything on one page that needs no other file; and the other files of the output folder."""
import base64
import html
import shlex
from pathlib import Path

from . import evo, judge, layout, pictures, plots, start_pictures, summary
from .protocol import write_if_changed
from .store import Evaluation

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1500px;padding:0 1.5rem;color:#1b1f24}
h1{font-size:1.7rem}h2{margin-top:2.4rem;border-bottom:1px solid #d0d7de;padding-bottom:.2rem}
.scroll{overflow-x:auto}table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums}
th,td{padding:.25rem .55rem;border-bottom:1px solid #e4e8ec;text-align:right;white-space:nowrap}
th{position:sticky;top:0;background:#f3f5f8}td:first-child,td:nth-child(2),th:first-child,th:nth-child(2){text-align:left}
tr.total td{font-weight:600;background:#f8f9fb}img{max-width:100%}figure{margin:1.2rem 0}figcaption{color:#57606a;font-size:13px}
code,pre{font:12.5px/1.4 ui-monospace,monospace;background:#f3f5f8;border-radius:4px}pre{padding:.6rem;overflow-x:auto;white-space:pre-wrap}
.row{display:flex;flex-wrap:wrap;gap:1rem}.row figure{flex:0 1 31%}code{padding:.1rem .3rem}.failed{border-left:4px solid #c62828;padding-left:.8rem;margin:1rem 0}.note{color:#57606a}
"""
NO_STARTS = 'No start, or no Python module of dsorb: scripts/build.sh $(scripts/python_flags.sh).'


def escape(text):
    return html.escape(str(text))


def html_table(rows):
    """A table of summary rows; the heading explains each column as a tooltip."""
    head = ''.join(f'<th title="{escape(meaning)}">{column}</th>' for column, meaning in summary.COLUMNS.items())
    lines = [f'<tr><th>sequence</th><th>variant</th>{head}</tr>']
    for name, variant, row in rows:
        cells = ''.join(f'<td>{summary.text_of(row[c])}</td>' for c in summary.COLUMNS)
        lines.append(f'<tr{" class=total" if name == summary.TOTAL else ""}><td>{escape(name)}</td><td>{escape(variant)}</td>{cells}</tr>')
    return f'<div class=scroll><table>{"".join(lines)}</table></div>'


def html_figure(title, path, note):
    data = base64.b64encode(path.read_bytes()).decode()
    caption = escape(title) + (f' <span class=note>(as in Gladkova: {escape(note)})</span>' if note.startswith('figure')
                               else f' <span class=note>({escape(note)})</span>' if note else '')
    return f'<figure><img alt="{escape(title)}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'


def html_failed(runs):
    """Every failed run with its reason and the command that repeats it."""
    failed = [run for run in runs if run.failed]
    if not failed:
        return '<p>None.</p>'
    parts = []
    for run in failed:
        reason = run.figures['error'] or ''
        parts.append(f'<div class=failed><b>{escape(run.entry["key"])}</b>: exit {run.record["exit_code"]} after '
                     f'{run.record["wall_seconds"]:.1f} s. {escape(reason)}<pre>{escape(shlex.join(run.record["command"]))}</pre></div>')
    return ''.join(parts)


def facts(evaluation):
    """What was run, as HTML."""
    plan, done = evaluation.plan, evaluation.done()
    missing = len(evaluation.runs) - len(done)
    lines = [f'{len(done)} runs over {len(plan["sequences"])} sequences, variants {", ".join(plan["variants"])}; starts '
             f'<code>{escape(plan["starts"])}</code>, at most {plan["frames"]} frames a run, {plan["threads"]} thread(s), arguments '
             f'<code>{escape(shlex.join(plan["extra"]) or "none")}</code>.',
             f'Program <code>{escape(plan["program"])}</code>, build <code>{plan["build"][:16]}</code>.']
    if missing:
        lines.append(f'<b>{missing} runs of the plan were not done yet.</b>')
    return ''.join(f'<p>{line}</p>' for line in lines) + html_evo(evaluation)


def html_evo(evaluation):
    if not evaluation.plan['evo']:
        return '<p>evo was not asked.</p>'
    found = summary.evo_agreement(evaluation.runs)
    return (f'<p>evo computed ATE and RPE of {found["compared"]} trajectories too; the largest relative differences from ours are '
            f'{found["ate"]:.1e} (ATE) and {found["rpe"]:.1e} (RPE). It refused {found["refused"]}.</p>')


def configurations(plan):
    return ''.join(f'<details><summary>{escape(v)}</summary><pre>{escape(text)}</pre></details>' for v, text in plan['configs'].items())


def evo_plots(evaluation):
    """evo_traj's plots of one start per sequence, all variants against the truth; (title, path, note) each."""
    figures = []
    for sequence, (_, by_variant) in pictures.same_start(evaluation.plan, evaluation.runs).items():
        entry = evaluation.sequences[sequence]
        for old in (evaluation.folder / 'figures').glob(f'evo_{sequence}_*.png'):
            old.unlink()
        truth = layout.load_ground_truth(Path(entry['groundtruth']) if entry['groundtruth'] else None, Path(entry['path']), entry['format'])
        estimates = estimates_of(evaluation, by_variant) if truth else []
        if not estimates:
            continue
        try:
            _, true = truth.matched(max((rows for _, rows in estimates), key=len))
            target = evaluation.folder / 'figures' / f'evo_{sequence}.png'
            files = evo.trajectory_plot(true, estimates, target)
        except (RuntimeError, OSError) as error:
            files = []
            figures.append((f'evo_traj refused {sequence}: {error}', None, ''))
        figures += [(f'{sequence}: evo_traj', file, '') for file in files if 'trajectories' in file.stem]
    return figures


def estimates_of(evaluation, by_variant):
    """Trajectories (variant, rows) of one start, those that the metrics accept."""
    found = []
    for variant, run in by_variant.items():
        if summary.value_of(run.figures, 'frames'):
            out = evaluation.folder_of(run) / 'out'
            segment = judge.read_json(out / 'initialization.json')['initializations'][0]['segment']
            found.append((variant, judge.first_segment_rows(out, 'trajectory.txt', judge.read_frames(out / 'frames.csv'), segment)))
    return found


def write_tables(evaluation):
    """summary.csv, summary.md and one table a data set. @return rows of all, tables of the data sets"""
    rows = summary.table(evaluation.plan, evaluation.done())
    tables = summary.dataset_tables(evaluation.plan, evaluation.done())
    head = f"Starts `{evaluation.plan['starts']}`, {evaluation.plan['frames']} frames, build `{evaluation.plan['build'][:16]}`.\n\n"
    write_if_changed(evaluation.folder / 'summary.csv', summary.to_csv(rows))
    write_if_changed(evaluation.folder / 'summary.md', head + summary.to_markdown(rows) + '\n' + summary.legend())
    for dataset, part in tables.items():
        write_if_changed(evaluation.folder / 'tables' / f'{dataset}.csv', summary.to_csv(part))
        write_if_changed(evaluation.folder / 'tables' / f'{dataset}.md', head + summary.to_markdown(part))
    failed = ''.join(f'{run.record["exit_code"]}\t{shlex.join(run.record["command"])}\n' for run in evaluation.done() if run.failed)
    write_if_changed(evaluation.folder / 'failed.txt', failed)
    return rows, tables


def write(folder):
    """Writes all results of an output folder. @return Evaluation"""
    evaluation = Evaluation(folder)
    rows, tables = write_tables(evaluation)
    target = evaluation.folder / 'figures'
    target.mkdir(exist_ok=True)
    done = evaluation.done()
    curves = plots.all_figures(evaluation.plan, done, summary.datasets(evaluation.plan), target)
    overlays, tracking = (make(evaluation.plan, done, evaluation.folder_of, target)
                          for make in (pictures.overlay_figures, pictures.tracking_figures))
    histograms, searches = start_pictures.figures(evaluation)
    trajectories = evo_plots(evaluation) if evaluation.plan['evo'] else []
    parts = ['<h2>Summary</h2>', html_table(rows)]
    parts += [html_figure(f'{group}: {title}', path, note) for group, title, path, note in curves if group == 'all']
    for dataset, part in tables.items():
        parts += [f'<h2>{escape(dataset)}</h2>', html_table(part)]
        parts += [html_figure(f'{group}: {title}', path, note) for group, title, path, note in curves if group == dataset]
    parts += [f'<h2>{title}</h2>' + section(figures, otherwise) for title, figures, otherwise in (
        ('Initial inverse depth', overlays, 'No run left an overlay.'),
        ('Residuals of the initial points', histograms, NO_STARTS),
        ('Residuals of tracked frames', tracking, 'No frame was tracked.'),
        ('Epipolar search', searches, NO_STARTS),
        ('Trajectories', trajectories, 'Not drawn.'))]
    parts += ['<h2>Failed runs</h2>', html_failed(done), '<h2>Configurations</h2>', configurations(evaluation.plan)]
    page = (f'<!doctype html><html lang=en><meta charset=utf-8><title>dsorb evaluation</title><style>{STYLE}</style>'
            f'<h1>dsorb evaluation</h1>{facts(evaluation)}{"".join(parts)}</html>\n')
    write_if_changed(evaluation.folder / 'report.html', page)
    return evaluation


def section(figures, otherwise):
    """Figures of a section, or the sentence that says why there are none."""
    if not figures:
        return f'<p class=note>{escape(otherwise)}</p>'
    parts = [html_figure(*figure) if figure[1] else f'<p class=note>{escape(figure[0])}</p>' for figure in figures]
    return f'<div class={"row" if "Residuals" in figures[0][0] or "Tracked" in figures[0][0] else "column"}>{"".join(parts)}</div>'
