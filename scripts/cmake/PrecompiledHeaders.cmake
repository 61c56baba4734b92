# SPDX-License-Identifier: BSD-3-Clause
# dsorb_precompile(TARGET FIRST HEADERS...): TARGET gets the precompiled headers that the target FIRST owns; FIRST makes
# them from HEADERS. Only headers of others are precompiled. A source still includes what it uses: lint.sh compiles
# without them. CMAKE_DISABLE_PRECOMPILE_HEADERS=ON turns them off. Every TARGET links Eigen3::Eigen and TBB::tbb: their
# definitions (TBB_USE_DEBUG) are part of what is precompiled.
set(dsorb_library_headers
  <algorithm> <array> <charconv> <cmath> <cstdint> <cstring> <deque> <filesystem> <functional> <map> <memory> <mutex>
  <numeric> <optional> <stdexcept> <string> <string_view> <thread> <utility> <variant> <vector>
  <Eigen/Dense> <tbb/info.h> <tbb/parallel_for.h> <tbb/parallel_invoke.h> <tbb/task_arena.h>)

function(dsorb_precompile target first)
  # dsorb_io has flags of its own there: Warnings.cmake.
  if(target STREQUAL first OR (target STREQUAL dsorb_io AND (DSORB_BUILD_FUZZERS OR DSORB_SANITIZE MATCHES address)))
    target_precompile_headers(${target} PRIVATE ${ARGN})
  else()
    target_precompile_headers(${target} REUSE_FROM ${first})
  endif()
endfunction()

# ccache knows what a precompiled header holds only when it is told so.
if(CMAKE_CXX_COMPILER_LAUNCHER MATCHES "ccache$" AND NOT CMAKE_DISABLE_PRECOMPILE_HEADERS)
  list(PREPEND CMAKE_CXX_COMPILER_LAUNCHER env CCACHE_SLOPPINESS=pch_defines,time_macros)
endif()
