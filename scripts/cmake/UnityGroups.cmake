# SPDX-License-Identifier: BSD-3-Clause
# With CMAKE_UNITY_BUILD=ON sources of one folder are compiled together, at most dsorb_unity_size at a time: a third less
# time for a build from nothing, more for one changed file. Names in anonymous namespaces of one folder must differ for it.
# A source that has a UNITY_GROUP keeps it.
set(dsorb_unity_size 16)

# dsorb_unity_groups(): of all targets of the current directory.
function(dsorb_unity_groups)
  get_property(targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(type ${target} TYPE)
    if(NOT type MATCHES "LIBRARY|EXECUTABLE" OR type STREQUAL "INTERFACE_LIBRARY")
      continue()
    endif()
    set_target_properties(${target} PROPERTIES UNITY_BUILD_MODE GROUP)
    get_target_property(sources ${target} SOURCES)
    foreach(source IN LISTS sources)
      get_source_file_property(group "${source}" UNITY_GROUP)
      if(group)
        continue()
      endif()
      get_filename_component(folder "${source}" DIRECTORY)
      string(MAKE_C_IDENTIFIER "${target}_${folder}" group)
      math(EXPR part "0${${group}} / ${dsorb_unity_size}")
      math(EXPR ${group} "0${${group}} + 1")
      set_source_files_properties("${source}" PROPERTIES UNITY_GROUP ${group}_${part})
    endforeach()
  endforeach()
endfunction()
