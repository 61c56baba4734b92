// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

/// DSORB_SHUFFLE(a, b, i...): the vector of the elements i... of the two vectors a and b, counted
/// through both. GCC has the builtin from version 12 on; before, a loop over the elements is
/// unrolled.
#if defined(__has_builtin) && __has_builtin(__builtin_shufflevector)
#define DSORB_SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define DSORB_SHUFFLE(a, b, ...) ::dsorb::shuffled<__VA_ARGS__>(a, b)

namespace dsorb {

template <int... kIndex, typename Vector>
inline __attribute__((always_inline)) auto shuffled(const Vector& a, const Vector& b) {
  using Scalar = std::remove_cv_t<std::remove_reference_t<decltype(a[0])>>;
  constexpr int kSize = sizeof(Vector) / sizeof(Scalar);
  typedef Scalar Result __attribute__((vector_size(sizeof...(kIndex) * sizeof(Scalar))));
  return Result{(kIndex < kSize ? a[kIndex % kSize] : b[kIndex % kSize])...};
}

}  // namespace dsorb
#endif
