# SPDX-License-Identifier: BSD-3-Clause
# Installs the build to a fresh prefix, then configures, builds and runs the outside project against it; at last
# configures one that takes the sources in.
#   cmake -DBUILD_DIR=... -DSOURCE_DIR=... -DWORK_DIR=... -DCOMPONENTS=... -DCXX=... -P run.cmake
function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGV}\n${output}")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK_DIR})
# Modules of the names of all that is looked for; they say so if they are asked.
set(modules ${WORK_DIR}/modules)
foreach(name Eigen3 TBB OpenCV Ceres Threads yaml-cpp nlohmann_json fmt JPEG PNG PkgConfig CLI11 spdlog GTest benchmark)
  file(WRITE ${modules}/Find${name}.cmake "message(FATAL_ERROR \"somebody's Find${name}.cmake was asked\")\n")
endforeach()
run(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${WORK_DIR}/prefix)
# All programs, or those of a list.
function(build_and_run folder flags)
  run(${CMAKE_COMMAND} -S ${SOURCE_DIR} -B ${WORK_DIR}/${folder} -DCMAKE_PREFIX_PATH=${WORK_DIR}/prefix
      -DCMAKE_C_FLAGS=${flags} -DCMAKE_CXX_FLAGS=${flags} -DCONSUMER_COMPONENTS=${COMPONENTS})
  set(targets ${ARGN})
  list(TRANSFORM targets PREPEND "--target;")
  run(${CMAKE_COMMAND} --build ${WORK_DIR}/${folder} --parallel 2 ${targets})
  list(JOIN ARGN "|" names)
  run(${CMAKE_CTEST_COMMAND} --test-dir ${WORK_DIR}/${folder} --parallel 2 --output-on-failure -R "${names}")
endfunction()

# The programs alone have AddressSanitizer in them.
set(sanitized "-O1 -fsanitize=address -fno-omit-frame-pointer")
build_and_run(build ${sanitized})

# Components by pkg-config alone, one expression of each; the first example stands for init.
function(build_by_pkg_config component source)
  execute_process(COMMAND ${pkg_config} --cflags --libs dsorb-${component} OUTPUT_VARIABLE flags
                  COMMAND_ERROR_IS_FATAL ANY OUTPUT_STRIP_TRAILING_WHITESPACE)
  separate_arguments(flags UNIX_COMMAND "${flags}")
  run(${CXX} -std=c++17 -O1 ${source} -o ${WORK_DIR}/by_pkg_config_${component} ${flags} -Wl,-rpath,${library_folder})
  run(${WORK_DIR}/by_pkg_config_${component})
endfunction()
function(build_expression component header expression)
  set(source ${WORK_DIR}/${component}.cpp)
  file(WRITE ${source} "#include <dsorb/${header}>\nint main() { return ${expression} ? 0 : 1; }\n")
  build_by_pkg_config(${component} ${source})
endfunction()
find_program(pkg_config pkg-config REQUIRED)
file(GLOB_RECURSE package_file ${WORK_DIR}/prefix/*/dsorb-init.pc)
if(package_file)
  get_filename_component(package_folder ${package_file} DIRECTORY)
  get_filename_component(library_folder ${package_folder} DIRECTORY)
  set(ENV{PKG_CONFIG_PATH} ${package_folder})
  build_expression(core image/pyramid.h "dsorb::pyramidLevels(640, 480) == 4")
  build_by_pkg_config(init ${SOURCE_DIR}/01_initialize_from_images.cpp)
  build_expression(odometry c/dsorb.h "dsorb_version()[0] == '0'")
  build_expression(io io/config.h "dsorb::loadConfig({}).initializer == \"orb\"")
  include(${SOURCE_DIR}/exports.cmake)
  check_exports(${library_folder})
  count_libraries(${WORK_DIR}/by_pkg_config_init)
endif()

# Compilers of an older standard are told so, and no more.
file(GLOB_RECURSE headers RELATIVE ${WORK_DIR}/prefix/include ${WORK_DIR}/prefix/include/dsorb/*.h)
list(FILTER headers EXCLUDE REGEX "^dsorb/c/")
foreach(header IN LISTS headers)
  file(WRITE ${WORK_DIR}/old.cpp "#include <${header}>\n")
  execute_process(COMMAND ${CXX} -std=c++0x -fsyntax-only -I${WORK_DIR}/prefix/include ${WORK_DIR}/old.cpp
                  RESULT_VARIABLE result ERROR_VARIABLE output)
  string(REGEX MATCHALL "[^\n]* error: [^\n]*" errors "${output}")
  list(LENGTH errors count)
  if(result EQUAL 0 OR NOT output MATCHES "error: #?(error )?\"dsorb needs C\\+\\+17: " OR count GREATER 2)
    message(FATAL_ERROR "${header} with -std=c++0x must say that it needs C++17:\n${output}")
  endif()
endforeach()

# Once more for another instruction set: Eigen aligns to 32 bytes there, in the library to 16. Those programs that hand
# every kind of object with Eigen in it across.
file(STRINGS /proc/cpuinfo processor REGEX "^flags.* fma .* avx2 .*" LIMIT_COUNT 1)
if(processor)
  build_and_run(haswell "-march=haswell ${sanitized}" layout 02_own_back_end 03_own_initializer)
else()
  message(WARNING "SKIPPED: this processor has no AVX2 or FMA and cannot run programs for -march=haswell")
endif()

execute_process(COMMAND ${CMAKE_COMMAND} -S ${SOURCE_DIR} -B ${WORK_DIR}/wrong
                -DCMAKE_PREFIX_PATH=${WORK_DIR}/prefix -DCONSUMER_COMPONENTS=no_such_part
                RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
if(result EQUAL 0 OR NOT output MATCHES "no_such_part")
  message(FATAL_ERROR "an unknown component must fail with its name:\n${output}")
endif()

set(foreign -DCMAKE_MODULE_PATH=${modules})
run(${CMAKE_COMMAND} -S ${SOURCE_DIR}/subproject -B ${WORK_DIR}/subproject -DDSORB_SOURCE_DIR=${SOURCE_DIR}/../.. ${foreign})
# Shared libraries need little from a package file; those of a static build ask for everything.
run(${CMAKE_COMMAND} -S ${SOURCE_DIR}/../.. -B ${WORK_DIR}/static -DBUILD_SHARED_LIBS=OFF -DDSORB_BUILD_TESTS=OFF ${foreign})
file(WRITE ${WORK_DIR}/static/dsorbTargets.cmake "")
file(WRITE ${WORK_DIR}/probe/CMakeLists.txt "cmake_minimum_required(VERSION 3.22)\nproject(probe LANGUAGES C CXX)\n"
     "find_package(dsorb REQUIRED)\nif(NOT CMAKE_MODULE_PATH STREQUAL \"${modules}\" OR NOT fmt_FOUND)\n"
     "  message(FATAL_ERROR \"the path of modules became \${CMAKE_MODULE_PATH}\")\nendif()\n")
run(${CMAKE_COMMAND} -S ${WORK_DIR}/probe -B ${WORK_DIR}/probe/build -Ddsorb_DIR=${WORK_DIR}/static ${foreign})
