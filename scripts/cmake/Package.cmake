# SPDX-License-Identifier: BSD-3-Clause
# Debian packages of what is installed, by `cpack -G DEB` in the build folder. What they depend on is read from what their
# files are linked with. dsorb-codecs has the module of OpenCV's codecs and nothing else. Only shared libraries: static
# ones have the codecs inside the programs.
if(NOT PROJECT_IS_TOP_LEVEL OR NOT BUILD_SHARED_LIBS)
  return()
endif()
set(dsorb_codecs_effect "Debian links OpenCV's imgcodecs and videoio, which the module in this package uses, with libraries
under the GNU General Public License, version 2 or later (FFmpeg as Debian configures it, poppler behind GDAL). The module
itself is under the licence below. See /usr/share/common-licenses/GPL-2.")
if(DSORB_WITH_CERES)
  set(dsorb_package dsorb)
  set(dsorb_effect "dsorb itself is under the licence below. This package is linked with Debian's Ceres, and through it with
parts of SuiteSparse (CHOLMOD's supernodal part, SPQR) under the GNU General Public License, version 2 or later: the
package as a whole may be distributed under the terms of the GPL only. See /usr/share/common-licenses/GPL-2. The package
dsorb-without-ceres has no such part.")
else()
  set(dsorb_package dsorb-without-ceres)
  set(dsorb_effect "This package is linked with nothing that is under the GPL: it was built without Ceres
(DSORB_WITH_CERES=OFF), and what reads videos and images other than PNG and JPEG is in the package dsorb-codecs.")
endif()
file(READ LICENSE dsorb_license)
function(dsorb_copyright package effect)
  set(file ${PROJECT_BINARY_DIR}/${package}/copyright)
  file(WRITE ${file} "${effect}\n\n${dsorb_license}")
  install(FILES ${file} DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package} ${ARGN})
endfunction()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME dsorb)
set(CPACK_PACKAGE_CONTACT "the dsorb authors <dsorb@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR}/lib)

dsorb_copyright(${dsorb_package} "${dsorb_effect}")
set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_NAME ${dsorb_package})
set(CPACK_DEBIAN_UNSPECIFIED_DESCRIPTION "${dsorb_effect}")
set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_SUGGESTS libeigen3-dev)
if(DSORB_WITH_CERES)
  set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_CONFLICTS dsorb-without-ceres)
else()
  set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_PROVIDES dsorb)
  set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_CONFLICTS dsorb)
endif()
if(TARGET dsorb_codecs)
  dsorb_copyright(dsorb-codecs "${dsorb_codecs_effect}" COMPONENT codecs)
  set(CPACK_DEBIAN_CODECS_PACKAGE_NAME dsorb-codecs)
  set(CPACK_DEBIAN_CODECS_DESCRIPTION "${dsorb_codecs_effect}")
  set(CPACK_DEBIAN_CODECS_PACKAGE_ENHANCES "dsorb, dsorb-without-ceres")
  set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_RECOMMENDS "dsorb-codecs (= ${PROJECT_VERSION})")
endif()
include(CPack)
