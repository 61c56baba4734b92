# SPDX-License-Identifier: BSD-3-Clause
# Installs libraries, public headers, programs and the package files for find_package(dsorb).
include(CMakePackageConfigHelpers)
set(dsorb_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/dsorb)

set(dsorb_installed core)
foreach(component init odometry io)
  if(TARGET dsorb_${component})
    list(APPEND dsorb_installed ${component})
  endif()
endforeach()
set(dsorb_init_opencv core imgproc features2d calib3d)
list(TRANSFORM dsorb_installed PREPEND dsorb_ OUTPUT_VARIABLE dsorb_libraries)
set(dsorb_beside_installed) # each needs one of the chain alone
foreach(component published place)
  if(TARGET dsorb_${component})
    list(APPEND dsorb_beside_installed ${component})
    list(APPEND dsorb_libraries dsorb_${component})
  endif()
endforeach()
install(TARGETS ${dsorb_libraries} EXPORT dsorbTargets
        RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR}
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
if(TARGET dsorb_codecs)
  install(TARGETS dsorb_codecs LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT codecs)
endif()
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
configure_file(scripts/cmake/dsorbDependencies.cmake.in ${PROJECT_BINARY_DIR}/dsorbDependencies.cmake @ONLY)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/dsorbConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/dsorbConfig.cmake ${PROJECT_BINARY_DIR}/dsorbDependencies.cmake
              ${PROJECT_BINARY_DIR}/dsorbConfigVersion.cmake
        DESTINATION ${dsorb_package_dir})

# pkg-config, for shared libraries: what these are linked with has pkg-config files in part only.
if(BUILD_SHARED_LIBS)
  file(RELATIVE_PATH dsorb_pc_prefix ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
  set(dsorb_pc_requires "eigen3 >= 3.4")
  foreach(component IN LISTS dsorb_installed)
    configure_file(scripts/cmake/dsorb.pc.in ${PROJECT_BINARY_DIR}/dsorb-${component}.pc @ONLY)
    install(FILES ${PROJECT_BINARY_DIR}/dsorb-${component}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
    set(dsorb_pc_requires "dsorb-${component} = ${PROJECT_VERSION}")
  endforeach()
  set(dsorb_published_needs init)
  set(dsorb_place_needs odometry)
  foreach(component IN LISTS dsorb_beside_installed)
    set(dsorb_pc_requires "dsorb-${dsorb_${component}_needs} = ${PROJECT_VERSION}")
    configure_file(scripts/cmake/dsorb.pc.in ${PROJECT_BINARY_DIR}/dsorb-${component}.pc @ONLY)
    install(FILES ${PROJECT_BINARY_DIR}/dsorb-${component}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
  endforeach()
endif()
