// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/shuffle.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#define DSORB_ALWAYS_INLINE inline __attribute__((always_inline))

namespace dsorb {

/// Eight floats in one (AVX) or two (SSE) registers; element-wise operators are the compiler's.
/// Functions that take or return them by value are always inlined: how these are passed depends on
/// the instruction set.
using Lanes = float __attribute__((vector_size(32)));
constexpr int kLanes = 8;

/// Results of comparisons: -1 in a lane where it holds, 0 where it does not.
using LaneMask = std::int32_t __attribute__((vector_size(sizeof(Lanes))));

/// Four doubles, the same way.
using DoubleLanes = double __attribute__((vector_size(32)));
constexpr int kDoubleLanes = 4;

DSORB_ALWAYS_INLINE Lanes load(const float* source) {
  Lanes lanes;
  std::memcpy(&lanes, source, sizeof(Lanes));
  return lanes;
}
DSORB_ALWAYS_INLINE void store(const Lanes& lanes, float* target) {
  std::memcpy(target, &lanes, sizeof(Lanes));
}
DSORB_ALWAYS_INLINE void addLanes(const Lanes& lanes, float* target) {
  store(load(target) + lanes, target);
}

DSORB_ALWAYS_INLINE DoubleLanes loadDoubles(const double* source) {
  DoubleLanes lanes;
  std::memcpy(&lanes, source, sizeof(DoubleLanes));
  return lanes;
}
/// Four floats, widened.
DSORB_ALWAYS_INLINE DoubleLanes loadDoubles(const float* source) {
  float values __attribute__((vector_size(16)));
  std::memcpy(&values, source, sizeof(values));
  return __builtin_convertvector(values, DoubleLanes);
}
DSORB_ALWAYS_INLINE void store(const DoubleLanes& lanes, double* target) {
  std::memcpy(target, &lanes, sizeof(DoubleLanes));
}

/// The same number in all lanes.
/// @tparam T a number, Lanes or DoubleLanes
template <typename T, typename Scalar>
DSORB_ALWAYS_INLINE T spread(Scalar value) {
  if constexpr (std::is_arithmetic_v<T>) {
    return static_cast<T>(value);
  } else if constexpr (std::is_same_v<T, Lanes>) {
    return T{value, value, value, value, value, value, value, value};
  } else {
    return T{value, value, value, value};
  }
}

/// Stores lane k of six vectors side by side at target + k * stride, for each k.
DSORB_ALWAYS_INLINE void storeTransposed(const DoubleLanes (&v)[6],
                                         double* target,
                                         std::size_t stride) {
  for (int k = 0; k < kDoubleLanes; ++k, target += stride) {
    for (int i = 0; i < 6; ++i) target[i] = v[i][k];
  }
}

DSORB_ALWAYS_INLINE bool inAllLanes(const LaneMask& mask) {
  std::int32_t all = -1;
  for (int k = 0; k < kLanes; ++k) all &= mask[k];
  return all != 0;
}
DSORB_ALWAYS_INLINE bool inAnyLane(const LaneMask& mask) {
  std::int32_t any = 0;
  for (int k = 0; k < kLanes; ++k) any |= mask[k];
  return any != 0;
}

/// Square roots of all lanes, at once where the file is compiled with -fno-math-errno.
DSORB_ALWAYS_INLINE Lanes squareRoots(const Lanes& lanes) {
  float values[kLanes];
  store(lanes, values);
  for (float& value : values) value = std::sqrt(value);
  return load(values);
}

/// Sums over the lanes of eight vectors at once. Every sum is added in the same, fixed order.
/// @param v eight vectors
/// @return  lane i is the sum over the lanes of v[i]
DSORB_ALWAYS_INLINE Lanes sumLanes(const Lanes (&v)[8]) {
  Lanes pairs[4];
  for (std::size_t i = 0; i < 4; ++i) {
    const Lanes& a = v[2 * i];
    const Lanes& b = v[2 * i + 1];
    pairs[i] = DSORB_SHUFFLE(a, b, 0, 8, 2, 10, 4, 12, 6, 14) +
               DSORB_SHUFFLE(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
  }
  Lanes quads[2];
  for (std::size_t i = 0; i < 2; ++i) {
    const Lanes& a = pairs[2 * i];
    const Lanes& b = pairs[2 * i + 1];
    quads[i] = DSORB_SHUFFLE(a, b, 0, 1, 8, 9, 4, 5, 12, 13) +
               DSORB_SHUFFLE(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
  }
  return DSORB_SHUFFLE(quads[0], quads[1], 0, 1, 2, 3, 8, 9, 10, 11) +
         DSORB_SHUFFLE(quads[0], quads[1], 4, 5, 6, 7, 12, 13, 14, 15);
}

/// Sum over the lanes of one vector, in a fixed order.
DSORB_ALWAYS_INLINE float sumLanes(const Lanes& v) {
  return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
}
DSORB_ALWAYS_INLINE double sumLanes(const DoubleLanes& v) {
  return (v[0] + v[1]) + (v[2] + v[3]);
}

}  // namespace dsorb
