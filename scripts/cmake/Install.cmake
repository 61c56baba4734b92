# SPDX-License-Identifier: BSD-3-Clause
# Installs libraries, public headers, programs and the package files for find_package(dsorb).
include(CMakePackageConfigHelpers)
set(dsorb_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/dsorb)

install(TARGETS dsorb_core dsorb_init dsorb_odometry dsorb_io EXPORT dsorbTargets
        RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR}
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY include/dsorb DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(DSORB_BUILD_PROGRAMS)
  install(TARGETS dso_dataset dso_synthesize RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(EXPORT dsorbTargets NAMESPACE dsorb:: DESTINATION ${dsorb_package_dir})

if(NOT DEFINED BUILD_SHARED_LIBS)
  set(BUILD_SHARED_LIBS OFF)
endif()
configure_package_config_file(scripts/cmake/dsorbConfig.cmake.in ${PROJECT_BINARY_DIR}/dsorbConfig.cmake
                              INSTALL_DESTINATION ${dsorb_package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/dsorbConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/dsorbConfig.cmake ${PROJECT_BINARY_DIR}/dsorbConfigVersion.cmake
        DESTINATION ${dsorb_package_dir})
