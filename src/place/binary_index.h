// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace dsorb::place {

/// 256 bits of an ORB descriptor.
using BinaryDescriptor = std::array<std::uint64_t, 4>;

/// Inverted file over binary descriptors. Its words are groups of bits (locality-sensitive
/// hashing): two descriptors share a word where all bits of a group agree. It needs no training,
/// takes images one by one and gives the same answers on every machine.
/// @source Gionis, Indyk, Motwani, Similarity Search in High Dimensions via Hashing, VLDB 1999
class BinaryIndex {
 public:
  BinaryIndex();

  /// Enters an image under the next number. @param descriptors the most distinctive first
  void add(const std::vector<BinaryDescriptor>& descriptors);

  /// Number of images.
  [[nodiscard]] std::size_t size() const { return sizes_.size(); }

  struct Candidate {
    std::size_t image = 0;
    double score = 0;  ///< sum of the rarities of the words in common
  };
  /// Images with most rare words in common, best first.
  /// @param count at most so many
  /// @param wanted whether an image may be an answer
  template <typename Wanted>
  [[nodiscard]] std::vector<Candidate> query(const std::vector<BinaryDescriptor>& descriptors,
                                             std::size_t count,
                                             Wanted&& wanted) const {
    const std::vector<float> scores = scoresOf(descriptors);
    std::vector<Candidate> found;
    for (std::size_t i = 0; i < scores.size(); ++i) {
      if (scores[i] > 0 && wanted(i)) found.push_back({i, static_cast<double>(scores[i])});
    }
    return best(std::move(found), count);
  }

  /// Bytes that the index takes.
  [[nodiscard]] std::size_t bytes() const;

 private:
  static constexpr int kTables = 4;
  static constexpr int kBits = 15;           // of a word
  static constexpr std::size_t kUsed = 300;  // descriptors of an image

  [[nodiscard]] std::vector<float> scoresOf(const std::vector<BinaryDescriptor>& descriptors) const;
  static std::vector<Candidate> best(std::vector<Candidate> found, std::size_t count);
  [[nodiscard]] std::size_t wordOf(const BinaryDescriptor& descriptor, int table) const;

  std::array<std::array<std::uint8_t, kBits>, kTables> bits_{};  // positions in a descriptor
  std::vector<std::vector<std::uint32_t>> images_;               // by word, ascending
  std::vector<std::uint32_t> sizes_;                             // descriptors entered, by image
};

}  // namespace dsorb::place
