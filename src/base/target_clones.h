// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Put before a hot function: compiled for the baseline and for machines with AVX2 and FMA, chosen
/// when the program starts. `arch=haswell` would not do: it asks for that very Intel model. It is
/// empty under sanitizers, which run before the choice is made, and where the compiler lacks it.
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12 && defined(__x86_64__) && \
    defined(__linux__) && !defined(__AVX2__) && !defined(__SANITIZE_ADDRESS__) &&        \
    !defined(__SANITIZE_THREAD__)
#define DSORB_TARGET_CLONES __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define DSORB_TARGET_CLONES
#endif
