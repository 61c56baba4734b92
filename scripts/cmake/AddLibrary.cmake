# SPDX-License-Identifier: BSD-3-Clause
# dsorb_add_library(NAME [STATIC]): target dsorb_NAME with alias dsorb::NAME; sources are added by the caller.
function(dsorb_add_library name)
  add_library(dsorb_${name} ${ARGN})
  add_library(dsorb::${name} ALIAS dsorb_${name})
  set_target_properties(dsorb_${name} PROPERTIES EXPORT_NAME ${name} VERSION ${PROJECT_VERSION}
                        SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR} DEFINE_SYMBOL "")
  target_compile_features(dsorb_${name} PUBLIC cxx_std_17)
  target_include_directories(dsorb_${name}
    PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
    PRIVATE ${PROJECT_SOURCE_DIR}/src)
  dsorb_compile_options(dsorb_${name})
  if(BUILD_SHARED_LIBS AND NOT APPLE)
    set(exports ${PROJECT_SOURCE_DIR}/scripts/cmake/exports.map)
    target_link_options(dsorb_${name} PRIVATE LINKER:--version-script=${exports})
    set_target_properties(dsorb_${name} PROPERTIES LINK_DEPENDS ${exports})
  endif()
  dsorb_precompile(dsorb_${name} dsorb_core ${dsorb_library_headers})
endfunction()
