#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Makes the Debian packages of a build folder, unpacks them into a root of its own, runs what is in them there and
# compares what each says about its licence with what it is linked with: run.sh BUILD_DIR WORK_DIR VERSION
set -euo pipefail
build=$1 work=$2 version=$3
for program in cpack dpkg-deb dpkg-shlibdeps; do
  command -v "$program" >/dev/null || { echo "SKIPPED: no $program"; exit 77; }
done

fail() { echo "$*" >&2; exit 1; }
root=$work/root
rm -rf "$work"
mkdir -p "$root"
(cd "$build" && cpack -G DEB -B "$work" >"$work/cpack.log" 2>&1) || { cat "$work/cpack.log"; exit 1; }

# unpack NAME: what the package depends on, and its copyright file.
unpack() {
  local package
  package=$(ls "$work/$1"_*.deb)
  dpkg-deb --info "$package"
  [ "$(dpkg-deb --field "$package" Version)" = "$version" ] || fail "the version of $1 is not $version"
  depends=$(dpkg-deb --field "$package" Depends)
  dpkg-deb -x "$package" "$root"
  copyright=$root/usr/share/doc/$1/copyright
  grep -q 'BSD 3-Clause' "$copyright" || fail "$copyright lacks the licence"
}
says_gpl() { grep -q 'GNU General Public License' "$copyright"; }

with_ceres='ceres|cholmod|spqr|umfpack|cxsparse|klu'
with_codecs='avcodec|avformat|x264|x265|poppler|gdal|videoio|imgcodecs'
name=dsorb
ls "$work"/dsorb_*.deb >/dev/null 2>&1 || name=dsorb-without-ceres
unpack "$name"
linked=$(echo "$depends" && find "$root" -type f \( -path '*/bin/*' -o -name '*.so*' \) -exec ldd {} + | awk '/=>/ { print $1 }')
! grep -E "$with_codecs" <<<"$linked" || fail "$name drags in codecs: they are for dsorb-codecs"
if [ "$name" = dsorb ]; then
  # Debian's Ceres is a static library: SuiteSparse is what a package with it depends on.
  [[ $depends == *libcholmod* ]] || fail "SuiteSparse is not among the dependencies of $name: $depends"
  says_gpl || fail "$copyright does not name the GPL"
else
  ! grep -E "$with_ceres" <<<"$linked" || fail "the package without Ceres is linked with it"
  grep -q 'nothing that is under the GPL' "$copyright" || fail "$copyright does not say that it is free of the GPL"
fi

# Its own libraries are found beside the programs, wherever the root is.
programs=$root/usr/bin
env -u LD_LIBRARY_PATH ldd "$programs/dso_dataset" | grep -F "$root" >/dev/null || fail "other libraries than the package's"
[ "$("$programs/dso_dataset" --version)" = "dso_dataset $version" ] || fail "dso_dataset is not version $version"
"$programs/dso_synthesize" room --output "$work/room" --frames 20 --width 320 --height 240 --quiet
"$programs/dso_dataset" "$work/room" --initializer=coarse --output "$work/run" --quiet
[ -s "$work/run/trajectory.txt" ] || fail "the run wrote no trajectory"

# Images other than PNG and JPEG are for the second package; the first names it.
mkdir "$work/grey"
{ printf 'P5 320 240 255\n'; head -c 76800 /dev/zero; } | tee "$work/grey/1.pgm" >"$work/grey/2.pgm"
dark() { "$programs/dso_dataset" "$work/grey" --hfov 60 --output "$work/dark" 2>&1 || true; }
dark | grep -q 'Debian package dsorb-codecs' || fail "without its codecs $name does not name their package: $(dark)"
unpack dsorb-codecs
grep -q imgcodecs <<<"$depends" || fail "dsorb-codecs does not depend on OpenCV's codecs: $depends"
! grep -E "$with_ceres" <<<"$depends" || fail "dsorb-codecs depends on Ceres"
says_gpl || fail "$copyright does not name the GPL"
! dark | grep dsorb-codecs || fail "with its package the codecs are still missing"
