# SPDX-License-Identifier: BSD-3-Clause
# check_exports(FOLDER): the shared libraries of dsorb in it show names of dsorb only. To one without a version script the
# linker adds three of its own.
function(check_exports folder)
  find_program(nm nm REQUIRED)
  file(GLOB libraries ${folder}/libdsorb_*.so)
  list(LENGTH libraries count)
  if(count LESS 4)
    message(FATAL_ERROR "${folder} has ${count} shared libraries of dsorb")
  endif()
  set(ours "((void )?dsorb::|dsorb_|dsorbCodecsModule$|(vtable|typeinfo|typeinfo name) for dsorb::")
  string(APPEND ours "|(virtual|non-virtual) thunk to dsorb::|(__bss_start|_edata|_end)$)")
  foreach(library IN LISTS libraries)
    execute_process(COMMAND ${nm} --dynamic --demangle --defined-only ${library} OUTPUT_VARIABLE symbols
                    COMMAND_ERROR_IS_FATAL ANY)
    string(REPLACE ";" " " symbols "${symbols}")
    string(REGEX REPLACE "\n$" "" symbols "${symbols}")
    string(REPLACE "\n" ";" symbols "${symbols}")
    list(LENGTH symbols shown)
    list(FILTER symbols EXCLUDE REGEX "^[0-9a-f ]+ [A-Za-z] ${ours}")
    if(symbols OR shown EQUAL 0)
      string(REPLACE ";" "\n" symbols "${symbols}")
      message(FATAL_ERROR "${library} shows ${shown} names, among them these of others:\n${symbols}")
    endif()
  endforeach()
endfunction()

# count_libraries(PROGRAM): what a program with dsorb::init loads, none of it OpenCV's codecs and what these bring.
function(count_libraries program)
  execute_process(COMMAND ldd ${program} OUTPUT_VARIABLE loaded COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "[^\n]+" loaded "${loaded}")
  list(LENGTH loaded count)
  set(limit 40) # measured 27 to 29
  if(count GREATER limit OR loaded MATCHES "gdal|imgcodecs|videoio|highgui")
    list(JOIN loaded "\n" loaded)
    message(FATAL_ERROR "a program with dsorb::init loads ${count} shared libraries, not ${limit} at most:\n${loaded}")
  endif()
endfunction()
