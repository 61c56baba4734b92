# SPDX-License-Identifier: BSD-3-Clause
# dsorb_add_benchmark(NAME SOURCES... [LIBS libraries...]): one Google Benchmark program. Not part of
# ctest; numbers are compared, not asserted.
function(dsorb_add_benchmark name)
  cmake_parse_arguments(arg "" "" "LIBS" ${ARGN})
  add_executable(${name} ${arg_UNPARSED_ARGUMENTS})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/test)
  target_link_libraries(${name} PRIVATE ${arg_LIBS} benchmark::benchmark_main)
  dsorb_compile_options(${name})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/benchmark)
endfunction()
