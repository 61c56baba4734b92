# SPDX-License-Identifier: BSD-3-Clause
# dsorb_embed_presets(TARGET): compiles every configs/*.yaml into the target as a string.
function(dsorb_embed_presets target)
  file(GLOB files CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/configs/*.yaml)
  set(DSORB_PRESET_ENTRIES "")
  foreach(file ${files})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
    get_filename_component(name ${file} NAME_WE)
    file(READ ${file} text)
    string(APPEND DSORB_PRESET_ENTRIES "      {\"${name}\", R\"yaml(${text})yaml\"},\n")
  endforeach()
  configure_file(${PROJECT_SOURCE_DIR}/src/io/presets.cpp.in ${CMAKE_CURRENT_BINARY_DIR}/io/presets.cpp @ONLY)
  target_sources(${target} PRIVATE ${CMAKE_CURRENT_BINARY_DIR}/io/presets.cpp)
endfunction()
