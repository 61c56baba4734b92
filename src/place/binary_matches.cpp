// SPDX-License-Identifier: BSD-3-Clause
#include "place/binary_matches.h"

#include "features/feature_matches.h"

#include <opencv2/core.hpp>

namespace dsorb::place {
namespace {

/// The descriptors where they are, as the front end takes them.
Features featuresOf(const std::vector<BinaryDescriptor>& descriptors) {
  Features features;
  features.points.resize(descriptors.size());
  if (descriptors.empty()) return features;
  // Nobody writes into it.
  void* const bytes = const_cast<BinaryDescriptor*>(descriptors.data());  // NOLINT
  features.descriptors = cv::Mat(static_cast<int>(descriptors.size()),
                                 static_cast<int>(sizeof(BinaryDescriptor)),
                                 CV_8UC1,
                                 bytes);
  return features;
}

}  // namespace

std::vector<int> mutualMatches(const std::vector<BinaryDescriptor>& from,
                               const std::vector<BinaryDescriptor>& to) {
  if (from.empty() || to.empty()) return std::vector<int>(from.size(), -1);
  return matchFeatures(featuresOf(from), featuresOf(to));
}

}  // namespace dsorb::place
