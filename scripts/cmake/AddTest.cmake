# SPDX-License-Identifier: BSD-3-Clause
# dsorb_test_options(TARGET): how tests are compiled.
function(dsorb_test_options target)
  dsorb_compile_options(${target})
  # Less than -O3 saves a quarter of the time to compile tests; what they test is optimized as ever.
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  if(DSORB_SANITIZE MATCHES undefined) # of what they test, not of themselves: a fifth of the compiler's time
    target_compile_options(${target} PRIVATE -fno-sanitize=undefined)
  endif()
  dsorb_precompile(${target} dsorb_test_main ${dsorb_library_headers} <gmock/gmock.h> <gtest/gtest.h>)
endfunction()

# dsorb_add_tests(PROGRAM LABEL SOURCES... [LIBS libraries...] [PARTS FILE parameters...]): one GoogleTest program,
# test/PROGRAM in the build folder. Each source NAME_test.cpp is a ctest entry NAME_test that runs what stands in that
# file; with PARTS the file FILE is one entry for each of these test parameters, to run side by side, and one for all
# the rest. Labels: unit, contract, system, package; target LABEL_tests builds the programs of one.
function(dsorb_add_tests program label)
  cmake_parse_arguments(arg "" "" "LIBS;PARTS" ${ARGN})
  set(CMAKE_POSITION_INDEPENDENT_CODE OFF) # or a library's precompiled headers were none for a program
  if(NOT TARGET dsorb_test_main)
    add_library(dsorb_test_main STATIC ${PROJECT_SOURCE_DIR}/test/support/main.cpp)
    target_link_libraries(dsorb_test_main PUBLIC GTest::gmock GTest::gtest TBB::tbb PRIVATE Eigen3::Eigen)
    dsorb_test_options(dsorb_test_main)
  endif()
  if(NOT TARGET ${label}_tests)
    add_custom_target(${label}_tests)
  endif()
  add_executable(${program} ${arg_UNPARSED_ARGUMENTS})
  target_include_directories(${program} PRIVATE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/test)
  target_link_libraries(${program} PRIVATE ${arg_LIBS} dsorb_test_main)
  dsorb_test_options(${program})
  set_target_properties(${program} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/test)
  add_dependencies(${label}_tests ${program})

  set(timeout 300)
  if(DSORB_SANITIZE)
    set(timeout 1500)
  elseif(CMAKE_CROSSCOMPILING_EMULATOR) # takes some twenty times as long as the processor itself
    set(timeout 7200)
  endif()
  list(POP_FRONT arg_PARTS file_with_parts)
  list(FILTER arg_UNPARSED_ARGUMENTS INCLUDE REGEX "_test\\.cpp$")
  foreach(source IN LISTS arg_UNPARSED_ARGUMENTS)
    get_filename_component(file ${source} NAME_WE)
    set(entries ${file})
    set(rest "*-")
    if(file STREQUAL file_with_parts)
      foreach(part IN LISTS arg_PARTS)
        add_test(NAME ${file}_${part} COMMAND ${program} --file=${file} --gtest_filter=*/${part})
        list(APPEND entries ${file}_${part})
        string(APPEND rest "*/${part}:")
      endforeach()
    endif()
    add_test(NAME ${file} COMMAND ${program} --file=${file} --gtest_filter=${rest})
    set_tests_properties(${entries} PROPERTIES LABELS ${label} TIMEOUT ${timeout})
  endforeach()
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
