#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes the Debian package of a build folder, unpacks it into a root of its own and runs what is in it there:
# run.sh BUILD_DIR WORK_DIR VERSION
set -euo pipefail
build=$1 work=$2 version=$3
for program in cpack dpkg-deb dpkg-shlibdeps; do
  command -v "$program" >/dev/null || { echo "SKIPPED: no $program"; exit 77; }
done

fail() { echo "$*" >&2; exit 1; }
rm -rf "$work"
mkdir -p "$work/root"
(cd "$build" && cpack -G DEB -B "$work" >"$work/cpack.log" 2>&1) || { cat "$work/cpack.log"; exit 1; }
package=$(ls "$work"/*.deb)
dpkg-deb --info "$package"
[ "$(dpkg-deb --field "$package" Version)" = "$version" ] || fail "the package's version is not $version"
depends=$(dpkg-deb --field "$package" Depends)
name=$(dpkg-deb --field "$package" Package)
dpkg-deb -x "$package" "$work/root"
copyright=$work/root/usr/share/doc/$name/copyright
if [ "$name" = dsorb ]; then
  # Debian's Ceres is a static library: SuiteSparse is what a package with it depends on.
  [[ $depends == *libcholmod* ]] || fail "SuiteSparse is not among the package's dependencies: $depends"
  grep -q 'GNU General Public License' "$copyright" || fail "$copyright does not name the GPL"
else
  [[ $depends != *libceres* && $depends != *libcholmod* ]] || fail "the package without Ceres depends on it: $depends"
fi
grep -q 'BSD 3-Clause' "$copyright" || fail "$copyright lacks the licence"

# Its own libraries are found beside the programs, wherever the root is.
programs=$work/root/usr/bin
env -u LD_LIBRARY_PATH ldd "$programs/dso_dataset" | grep -F "$work/root" >/dev/null || fail "other libraries than the package's"
[ "$("$programs/dso_dataset" --version)" = "dso_dataset $version" ] || fail "dso_dataset is not version $version"
"$programs/dso_synthesize" room --output "$work/room" --frames 20 --width 320 --height 240 --quiet
"$programs/dso_dataset" "$work/room" --initializer=coarse --output "$work/run" --quiet
[ -s "$work/run/trajectory.txt" ] || fail "the run wrote no trajectory"
