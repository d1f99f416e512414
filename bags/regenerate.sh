#!/bin/sh
# Makes the recordings of this folder anew: equal stamps, samples within 1e-6 of the peak.
# usage: bags/regenerate.sh [FOLDER]    (default: this folder, whose recordings are replaced)
set -eu
folder=${1:-$(dirname "$0")}
for scene in triangle quadrilateral pentagon rectangle l_shape room; do
    storage=mcap
    if [ "$scene" = quadrilateral ]; then storage=sqlite3; fi
    rm -rf "${folder:?}/$scene"
    polymap_simulate "$scene" --output "$folder/$scene" --storage "$storage"
done
