# SPDX-License-Identifier: BSD-3-Clause
# A dependency that is too old is named with the version found and the one wanted: a folder pretends to be Ceres 1.14.0.
#   cmake -DSOURCE_DIR=... -DWORK_DIR=... -P old_dependency.cmake
file(REMOVE_RECURSE ${WORK_DIR})
set(package ${WORK_DIR}/prefix/lib/cmake/Ceres)
file(WRITE ${package}/CeresConfig.cmake "set(Ceres_FOUND TRUE)\n")
file(WRITE ${package}/CeresConfigVersion.cmake "set(PACKAGE_VERSION 1.14.0)\nset(PACKAGE_VERSION_COMPATIBLE TRUE)\n")
execute_process(COMMAND ${CMAKE_COMMAND} -S ${SOURCE_DIR} -B ${WORK_DIR}/build -DCMAKE_PREFIX_PATH=${WORK_DIR}/prefix
                -DDSORB_COMPONENTS=init
                RESULT_VARIABLE result OUTPUT_QUIET ERROR_VARIABLE message)
string(REGEX REPLACE "[ \n]+" " " message "${message}")
foreach(part "dsorb needs Ceres 2.0 or newer: found 1.14.0 in ${package}" "apt-get install libceres-dev")
  string(FIND "${message}" "${part}" found)
  if(result EQUAL 0 OR found EQUAL -1)
    message(FATAL_ERROR "Ceres 1.14.0 must be refused with '${part}':\n${message}")
  endif()
endforeach()
