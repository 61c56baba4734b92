// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "platform/files.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <utility>
#include <vector>

namespace dsorb::io {

/// A file without a name: it ends with the program, however that ends.
class NamelessFile {
 public:
  /// @param folder on whose disk it lies; the file is made when the first bytes come
  explicit NamelessFile(std::filesystem::path folder);

  /// @throws IoError where not all could be written
  void write(std::uintmax_t position, const void* bytes, std::size_t size);
  /// @throws IoError where not all could be read
  void read(std::uintmax_t position, void* bytes, std::size_t size) const;

 private:
  std::filesystem::path folder_;
  platform::Descriptor file_;
};

/// A list of which only the newest records are in memory, the others in a nameless file.
/// @tparam Record its bytes are all there is to it: nothing it points to
template <typename Record>
class Spool {
 public:
  static constexpr std::size_t kBlock = 1024;  ///< so many of the newest records stay in memory

  /// @param folder on whose disk the old records lie
  explicit Spool(std::filesystem::path folder) : file_(std::move(folder)) {}

  [[nodiscard]] std::size_t size() const { return stored_ + newest_.size(); }
  [[nodiscard]] bool empty() const { return size() == 0; }

  /// The record `age` places before the last one.
  /// @param age below size(), and below kBlock where nothing was popped since settle()
  [[nodiscard]] Record& newest(std::size_t age = 0) { return newest_[newest_.size() - 1 - age]; }
  [[nodiscard]] const Record& newest(std::size_t age = 0) const {
    return newest_[newest_.size() - 1 - age];
  }
  /// Any record; quick where the last one asked for was near. @throws IoError
  [[nodiscard]] Record at(std::size_t index) const {
    if (index >= stored_) return newest_[index - stored_];
    const std::size_t begin = index - index % kBlock;
    if (begin != block_begin_ || block_.empty()) {
      block_ = load(begin, std::min(kBlock, stored_ - begin));
      block_begin_ = begin;
    }
    return block_[index - begin];
  }

  void push(const Record& record) { newest_.push_back(record); }

  /// Removes the last record. @throws IoError
  void pop() {
    newest_.pop_back();
    if (!newest_.empty() || stored_ == 0) return;
    const std::size_t count = std::min(kBlock, stored_);
    newest_ = load(stored_ - count, count);
    stored_ -= count;
    block_.clear();
  }

  /// Puts all but the newest records on the disk. @throws IoError
  void settle() {
    if (newest_.size() < 2 * kBlock) return;
    const std::size_t count = newest_.size() - kBlock;
    file_.write(bytes(stored_), newest_.data(), bytes(count));
    newest_.erase(newest_.begin(), newest_.end() - kBlock);
    stored_ += count;
    block_.clear();
  }

 private:
  static constexpr std::size_t bytes(std::size_t records) { return records * sizeof(Record); }

  [[nodiscard]] std::vector<Record> load(std::size_t begin, std::size_t count) const {
    std::vector<Record> records(count);
    file_.read(bytes(begin), records.data(), bytes(count));
    return records;
  }

  NamelessFile file_;
  std::size_t stored_ = 0;  ///< records that are in the file
  std::vector<Record> newest_;
  mutable std::vector<Record> block_;  ///< of the file, read last
  mutable std::size_t block_begin_ = 0;
};

}  // namespace dsorb::io
