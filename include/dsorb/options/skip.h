// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <cstdint>
#include <string>
#include <vector>

namespace dsorb {

/// Mechanisms that a developer can take out of the finished stack, one by one or together, to
/// measure what each is worth (scripts/ablations.py). They are no part of the configuration.
enum class Mechanism : std::uint8_t {
  kPool,
  kFar,
  kBlank,
  kStuck,
  kDynamic,
  kRotation,
  kNoise,
  kRowMotions,
  kRefinement,
  kHopeless,
  kRetry,
  kYoung,
  kMisfit,
  kTail,
  kClusters,
  kPlane,
  kReadoutProfile,
  kJudge,
  kFillUp,
  kUncertain,
  kDoubtful,
  kUnfit,
  kGrey,
  kCameraScore,
  kMissed,
  kMatches,
  kProof,
  kExpected,
  kContrast,
  kEdges
};

/// A mechanism as the command line knows it.
struct MechanismName {
  Mechanism mechanism;      ///< which one
  const char* name;         ///< for example "pool"
  const char* description;  ///< what it does, in a few words
};

/// All mechanisms, in the order of the enumeration.
[[nodiscard]] const std::vector<MechanismName>& mechanisms();

/// Set of mechanisms that are left out.
class Skips {
 public:
  /// Leaves a mechanism out, too.
  void add(Mechanism mechanism) { bits_ |= bit(mechanism); }
  /// Whether a mechanism is left out.
  [[nodiscard]] bool has(Mechanism mechanism) const { return (bits_ & bit(mechanism)) != 0; }
  /// Whether none is left out.
  [[nodiscard]] bool empty() const { return bits_ == 0; }

 private:
  static std::uint64_t bit(Mechanism mechanism) {
    return std::uint64_t{1} << static_cast<unsigned>(mechanism);
  }
  std::uint64_t bits_ = 0;
};

/// Reads names with commas between them.
/// @throws ConfigError naming the word that is no mechanism, and those there are
[[nodiscard]] Skips parseSkips(const std::string& names);

}  // namespace dsorb
