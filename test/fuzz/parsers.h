// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb::fuzz {

/// A parser of files that users write, fed with any bytes. It may refuse them with the errors that
/// it promises; anything else that leaves it is a fault.
struct Parser {
  const char* name;  ///< also that of the folder with its inputs, below test/fuzz/corpus
  void (*feed)(const std::uint8_t* bytes, std::size_t size);
};

[[nodiscard]] const std::vector<Parser>& parsers();

}  // namespace dsorb::fuzz
