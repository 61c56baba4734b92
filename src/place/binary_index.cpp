// SPDX-License-Identifier: BSD-3-Clause
#include "place/binary_index.h"

#include "base/random.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace dsorb::place {
namespace {

constexpr std::uint64_t kIndexSeed = 20;  // any number
constexpr std::size_t kGrowth = 4;        // a list grows by a fourth
constexpr double kCommonWord = 0.2;  // share of the images; a word in more of them tells nothing

}  // namespace

BinaryIndex::BinaryIndex() : images_(static_cast<std::size_t>(kTables) << kBits) {
  std::array<std::uint8_t, 256> positions{};
  std::iota(positions.begin(), positions.end(), std::uint8_t{0});
  Random random(kIndexSeed);
  for (std::size_t i = positions.size() - 1; i > 0; --i) {
    const auto j = static_cast<std::size_t>(random.uniform() * static_cast<double>(i + 1));
    std::swap(positions[i], positions[std::min(j, i)]);
  }
  std::size_t next = 0;
  for (auto& table : bits_) {
    for (std::uint8_t& bit : table) bit = positions[next++];
  }
}

std::size_t BinaryIndex::wordOf(const BinaryDescriptor& descriptor, int table) const {
  std::size_t word = 0;
  for (const std::uint8_t bit : bits_[static_cast<std::size_t>(table)]) {
    word = 2 * word + ((descriptor[bit / 64U] >> (bit % 64U)) & 1U);
  }
  return (static_cast<std::size_t>(table) << kBits) + word;
}

void BinaryIndex::add(const std::vector<BinaryDescriptor>& descriptors) {
  const auto image = static_cast<std::uint32_t>(sizes_.size());
  const std::size_t used = std::min(descriptors.size(), kUsed);
  for (std::size_t i = 0; i < used; ++i) {
    for (int table = 0; table < kTables; ++table) {
      std::vector<std::uint32_t>& list = images_[wordOf(descriptors[i], table)];
      if (!list.empty() && list.back() == image) continue;
      if (list.size() == list.capacity()) list.reserve(list.size() + list.size() / kGrowth + 1);
      list.push_back(image);
    }
  }
  sizes_.push_back(static_cast<std::uint32_t>(used));
}

std::vector<float> BinaryIndex::scoresOf(const std::vector<BinaryDescriptor>& descriptors) const {
  std::vector<float> scores(sizes_.size(), 0.0F);
  const auto total = static_cast<double>(sizes_.size());
  const std::size_t used = std::min(descriptors.size(), kUsed);
  for (std::size_t i = 0; i < used; ++i) {
    for (int table = 0; table < kTables; ++table) {
      const std::vector<std::uint32_t>& list = images_[wordOf(descriptors[i], table)];
      const auto seen = static_cast<double>(list.size());
      if (list.empty() || seen > 1 + kCommonWord * total) continue;
      const auto rarity = static_cast<float>(std::log1p(total / seen));
      for (const std::uint32_t image : list) scores[image] += rarity;
    }
  }
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (sizes_[i] > 0) scores[i] /= std::sqrt(static_cast<float>(sizes_[i]));
  }
  return scores;
}

std::vector<BinaryIndex::Candidate> BinaryIndex::best(std::vector<Candidate> found,
                                                      std::size_t count) {
  const auto end = found.begin() + static_cast<std::ptrdiff_t>(std::min(count, found.size()));
  std::partial_sort(found.begin(), end, found.end(), [](const Candidate& a, const Candidate& b) {
    return a.score != b.score ? a.score > b.score : a.image < b.image;
  });
  found.erase(end, found.end());
  return found;
}

std::size_t BinaryIndex::bytes() const {
  std::size_t sum =
      images_.size() * sizeof(images_.front()) + sizes_.capacity() * sizeof(sizes_.front());
  for (const auto& list : images_) sum += list.capacity() * sizeof(list.front());
  return sum;
}

}  // namespace dsorb::place
