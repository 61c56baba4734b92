# SPDX-License-Identifier: BSD-3-Clause
"""Runs cases each in a process of its own: a crash, a hang or a word on standard error is a fault."""
import subprocess
import sys

LONGEST = 300  # [s]


def main(cases):
    """Runs all cases of a script, or the one that is named."""
    if len(sys.argv) > 1:
        cases[sys.argv[1]]()
        return
    faults = 0
    for name in cases:
        try:
            done = subprocess.run([sys.executable, sys.argv[0], name], capture_output=True, text=True, errors='replace', timeout=LONGEST,
                                  check=False)
            fault = f'exit {done.returncode}\n{done.stdout}{done.stderr}' if done.returncode or done.stderr else None
        except subprocess.TimeoutExpired:
            fault = f'hangs for {LONGEST} s'
        print(f'{sys.argv[0]} {name}: {fault or "holds"}', flush=True)
        faults += fault is not None
    sys.exit(faults > 0)


def case(cases):
    """Decorator: adds a function to the cases."""
    def add(function):
        cases[function.__name__] = function
        return function
    return add


if __name__ == '__main__':
    print('the cases are in the scripts beside this one')
