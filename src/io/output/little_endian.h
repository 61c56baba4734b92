// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>
#include <string>

namespace dsorb::io {

/// Appends a number of four bytes.
template <typename Value>
void appendLittleEndian(Value value, std::string& bytes) {
  std::uint32_t bits = 0;
  static_assert(sizeof(Value) == sizeof(bits));
  std::memcpy(&bits, &value, sizeof(bits));
  for (int shift = 0; shift < 32; shift += 8) {
    bytes.push_back(static_cast<char>((bits >> shift) & 0xFFU));
  }
}

/// Reads a number of four bytes.
template <typename Value>
[[nodiscard]] Value littleEndian(const char* bytes) {
  std::uint32_t bits = 0;
  static_assert(sizeof(Value) == sizeof(bits));
  for (unsigned i = 0; i < sizeof(bits); ++i) {
    bits |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i])) << (8 * i);
  }
  Value value;
  std::memcpy(&value, &bits, sizeof(bits));
  return value;
}

}  // namespace dsorb::io
