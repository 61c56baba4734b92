# SPDX-License-Identifier: BSD-3-Clause
# dsorb_compile_options(TARGET): warnings, arithmetic, sanitizers and the instruction set, private to our targets.
function(dsorb_compile_options target)
  # How the vectors of base/lanes.h are passed depends on the instruction set; functions that take or return them are always inlined.
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wconversion -Wshadow -Wno-psabi)
  # Eigen's fast square root of floats starts from the processor's estimate, whose bits are the maker's own.
  target_compile_definitions(${target} PRIVATE EIGEN_FAST_MATH=0)
  if(DSORB_WERROR)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
  if(DSORB_NATIVE)
    target_compile_options(${target} PRIVATE -march=native)
    # Matrices that programs pass are aligned as without it.
    target_compile_definitions(${target} PRIVATE EIGEN_MAX_STATIC_ALIGN_BYTES=16)
  endif()
  if(DSORB_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${DSORB_SANITIZE} -fno-omit-frame-pointer
                                             -fno-sanitize-recover=all)
    if(DSORB_SANITIZE MATCHES address) # finds what these would, and they take a quarter of the compiler's time
      target_compile_options(${target} PRIVATE -fno-sanitize=null,object-size)
      if(NOT target STREQUAL dsorb_io) # the bytes of files are read there; elsewhere a third of the compiler's time
        target_compile_options(${target} PRIVATE -fno-sanitize=alignment,pointer-overflow)
      endif()
    endif()
    target_compile_definitions(${target} PRIVATE DSORB_SANITIZED)
    target_link_options(${target} PRIVATE -fsanitize=${DSORB_SANITIZE})
  endif()
  if(DSORB_BUILD_FUZZERS AND target STREQUAL dsorb_io) # its parsers are where the fuzzer has to see its way
    target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)
  endif()
endfunction()
