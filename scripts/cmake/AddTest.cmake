# SPDX-License-Identifier: BSD-3-Clause
# dsorb_add_test(NAME LABEL SOURCES... [LIBS libraries...] [PARTS parameters...]): one GoogleTest program,
# registered as one ctest entry; with PARTS one entry for each of these test parameters, to run side by
# side, and one for all the rest. Labels: unit, contract, system, package; target LABEL_tests builds those of one.
function(dsorb_add_test name label)
  cmake_parse_arguments(arg "" "" "LIBS;PARTS" ${ARGN})
  add_executable(${name} ${arg_UNPARSED_ARGUMENTS})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/test)
  target_link_libraries(${name} PRIVATE ${arg_LIBS} GTest::gmock GTest::gtest_main)
  dsorb_compile_options(${name})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/test)
  if(NOT TARGET ${label}_tests)
    add_custom_target(${label}_tests)
  endif()
  add_dependencies(${label}_tests ${name})
  set(rest "*-")
  set(entries ${name})
  foreach(part IN LISTS arg_PARTS)
    add_test(NAME ${name}_${part} COMMAND ${name} --gtest_filter=*/${part})
    list(APPEND entries ${name}_${part})
    string(APPEND rest "*/${part}:")
  endforeach()
  add_test(NAME ${name} COMMAND ${name} --gtest_filter=${rest})
  set_tests_properties(${entries} PROPERTIES LABELS ${label} TIMEOUT 300)
  if(DSORB_SANITIZE)
    set_tests_properties(${entries} PROPERTIES TIMEOUT 1500)
  endif()
endfunction()

# dsorb_add_benchmark(NAME SOURCES... [LIBS libraries...]): one Google Benchmark program,
# benchmark/NAME in the build folder; NAME ends in _benchmark.
function(dsorb_add_benchmark name)
  cmake_parse_arguments(arg "" "" "LIBS" ${ARGN})
  add_executable(${name} ${arg_UNPARSED_ARGUMENTS})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/test)
  target_link_libraries(${name} PRIVATE ${arg_LIBS} TBB::tbb benchmark::benchmark_main)
  dsorb_compile_options(${name})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/benchmark)
endfunction()
