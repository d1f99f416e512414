"""How far does one have to walk to follow a solve? python test/way.py [--package DIR] [--scene SCENE].

Maps the simulated SCENE (default: pentagon, that of bags/pentagon) twice, and of the second solve, where everything is
loaded and compiled, prints:

calls
    Python calls of functions of the package, as `sys.setprofile` counts them: comprehensions and the resumptions of
    generators included, of compiled kernels only those from Python.
files
    In how many files these functions are.
changes
    How often a call is in another file than the one before it.
returns
    How often a reader comes back to a file left before, who reads every function once, at its first call: from the
    line that calls it, in the caller's file, to the callee's; then on to the next call of a function not yet read. One
    stay is what is read without leaving a file; returns are stays less files. Comprehensions and lambdas are no
    functions of their own here.

DIR is the checkout to measure; default: this one. The figures are the same at every run, but for the version of Python:
from 3.12 on list comprehensions are no calls.
"""

import argparse
import sys
from itertools import groupby
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--package', type=Path, default=TOP, metavar='DIR')
    parser.add_argument('--scene', default='pentagon')
    parser.add_argument('--list', action='store_true', help='print the stays, too, one a line')
    arguments = parser.parse_args()
    folder = arguments.package.resolve() / 'polymap_ros'
    sys.path.insert(0, str(folder.parent))
    calls = traced(arguments.scene, folder)
    files = [file for file, *_ in calls]
    stays = runs(read_once(calls))
    if arguments.list:
        print(*stays, sep='\n')
    print(f'calls {len(calls)}, files {len(set(files))}, changes {len(runs(files)) - 1}; '
          f'reading every function once: stays {len(stays)}, returns {len(stays) - len(set(stays))}')


def traced(scene, folder):
    """File and function of every call in a solve, and its caller's file, None where the caller is not known."""
    from polymap_ros.evaluation.trials import filled_mapper
    from polymap_ros.parameters import Parameters
    from polymap_ros.simulation.scene_file import load_scene

    calls = []

    def note(frame, event, _):
        if event == 'call' and (file := own(frame)):
            caller = frame.f_back
            while caller and not own(caller):
                caller = caller.f_back
            calls.append((file, frame.f_code.co_qualname, own(caller) if caller else None))

    def own(frame):
        path = Path(frame.f_code.co_filename)
        return str(path.relative_to(folder)) if path.is_relative_to(folder) else None

    filled_mapper(load_scene(scene), Parameters()).solve()
    mapper = filled_mapper(load_scene(scene), Parameters())
    sys.setprofile(note)
    mapper.solve()
    sys.setprofile(None)
    return calls


def read_once(calls):
    """Files in the order in which a reader looks into them."""
    read, files = set(), []
    for file, function, caller in calls:
        if (file, function) not in read and not function.endswith('>'):
            read.add((file, function))
            files += [caller, file] if caller else [file]
    return files


def runs(entries):
    return [entry for entry, _ in groupby(entries)]


if __name__ == '__main__':
    main()
