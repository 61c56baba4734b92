# SPDX-License-Identifier: BSD-3-Clause
# A Debian package of what is installed, by `cpack -G DEB` in the build folder. What it depends on is read from what its
# files are linked with.
if(NOT PROJECT_IS_TOP_LEVEL)
  return()
endif()
set(dsorb_copyright ${PROJECT_BINARY_DIR}/copyright)
file(READ LICENSE dsorb_license)
set(dsorb_effect "This package is linked with nothing that is under the GPL by dsorb's own choice: it was built without
Ceres (DSORB_WITH_CERES=OFF).")
set(CPACK_PACKAGE_NAME dsorb-without-ceres)
if(DSORB_WITH_CERES)
  set(CPACK_PACKAGE_NAME dsorb)
  set(dsorb_effect "dsorb itself is under the licence below. This package is linked with Debian's Ceres, and through it with
parts of SuiteSparse (CHOLMOD's supernodal part, SPQR) under the GNU General Public License, version 2 or later: the
package as a whole may be distributed under the terms of the GPL only. See /usr/share/common-licenses/GPL-2. The package
dsorb-without-ceres has no such part.")
endif()
file(WRITE ${dsorb_copyright} "${dsorb_effect}\n\n${dsorb_license}")
install(FILES ${dsorb_copyright} DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${CPACK_PACKAGE_NAME})

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "the dsorb authors <dsorb@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGE_DESCRIPTION "${dsorb_effect}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR}/lib)
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "libeigen3-dev")
if(DSORB_WITH_CERES)
  set(CPACK_DEBIAN_PACKAGE_CONFLICTS dsorb-without-ceres)
else()
  set(CPACK_DEBIAN_PACKAGE_PROVIDES dsorb)
  set(CPACK_DEBIAN_PACKAGE_CONFLICTS dsorb)
endif()
include(CPack)
