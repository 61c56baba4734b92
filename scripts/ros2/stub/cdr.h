// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

/// Little-endian CDR, as ROS 2 serializes messages.
namespace cdr {

constexpr std::size_t kHeader = 4;  // says which byte order

class Writer {
 public:
  std::vector<std::uint8_t> bytes{0, 1, 0, 0};

  template <typename Value>
  void operator()(Value& value) {
    if constexpr (std::is_arithmetic_v<Value>) {
      while ((bytes.size() - kHeader) % sizeof(Value) != 0) bytes.push_back(0);
      const auto* raw = reinterpret_cast<const std::uint8_t*>(&value);
      bytes.insert(bytes.end(), raw, raw + sizeof(Value));
    } else {
      fields(*this, value);
    }
  }
  void operator()(std::string& text) {
    auto size = static_cast<std::uint32_t>(text.size() + 1);
    (*this)(size);
    bytes.insert(bytes.end(), text.begin(), text.end());
    bytes.push_back(0);
  }
  template <typename Value, std::size_t kSize>
  void operator()(std::array<Value, kSize>& values) {
    for (Value& value : values) (*this)(value);
  }
  template <typename Value>
  void operator()(std::vector<Value>& values) {
    auto size = static_cast<std::uint32_t>(values.size());
    (*this)(size);
    for (Value& value : values) (*this)(value);
  }
};

class Reader {
 public:
  Reader(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  template <typename Value>
  void operator()(Value& value) {
    if constexpr (std::is_arithmetic_v<Value>) {
      while ((at_ - kHeader) % sizeof(Value) != 0) ++at_;
      std::memcpy(&value, take(sizeof(Value)), sizeof(Value));
    } else {
      fields(*this, value);
    }
  }
  void operator()(std::string& text) {
    std::uint32_t size = 0;
    (*this)(size);
    text.assign(reinterpret_cast<const char*>(take(size)), size > 0 ? size - 1 : 0);
  }
  template <typename Value, std::size_t kSize>
  void operator()(std::array<Value, kSize>& values) {
    for (Value& value : values) (*this)(value);
  }
  template <typename Value>
  void operator()(std::vector<Value>& values) {
    std::uint32_t size = 0;
    (*this)(size);
    if (size > size_) throw std::runtime_error("CDR: a sequence longer than its message");
    values.resize(size);
    if constexpr (sizeof(Value) == 1) {
      if (size > 0) std::memcpy(values.data(), take(size), size);
    } else {
      for (Value& value : values) (*this)(value);
    }
  }

 private:
  const std::uint8_t* take(std::size_t count) {
    if (count > size_ - at_) throw std::runtime_error("CDR: a message that ends early");
    at_ += count;
    return data_ + at_ - count;
  }
  const std::uint8_t* data_;
  std::size_t size_;
  std::size_t at_ = kHeader;
};

}  // namespace cdr
