// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace dsorb {

/// Erases the marked elements, order kept. @param marked not zero where marked; one an element
template <typename T>
void eraseMarked(const std::vector<char>& marked, std::vector<T>& elements) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < elements.size(); ++i) {
    if (marked[i] == 0) elements[kept++] = elements[i];
  }
  elements.resize(kept);
}

}  // namespace dsorb
