# SPDX-License-Identifier: BSD-3-Clause
"""python -m dsorb: the command `dsorb`, also where the folder of its script is not on the PATH."""
from dsorb.command_line import main

main()
