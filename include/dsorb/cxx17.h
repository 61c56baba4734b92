// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Every public header includes this first: one error stands for dozens.
#if __cplusplus < 201703L && !(defined(_MSVC_LANG) && _MSVC_LANG >= 201703L)
#error "dsorb needs C++17: a -std=c++0x or -std=c++11 among your own flags has to become -std=c++17"
#define DSORB_NEEDS_CXX17 "dsorb needs C++17"
#include DSORB_NEEDS_CXX17  // There is no such file: the compiler stops here.
#endif
