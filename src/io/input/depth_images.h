// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"

#include <filesystem>
#include <memory>
#include <string>

namespace dsorb {

/// Depth images of a sequence, one for each image: 16 bits, millimetres along the optical axis, 0
/// where there is none.
class DepthImages {
 public:
  /// No depth images.
  DepthImages() = default;
  /// @param folder         of the depth images
  /// @param relative_sigma standard deviation of a depth over it [-]
  /// @param width          of the rectified images, which they belong to [px]
  /// @param height         of the rectified images [px]
  /// @throws IoError without the folder
  DepthImages(std::filesystem::path folder, double relative_sigma, int width, int height);

  /// Priors of an image, from the file of its name, its suffix replaced by .png; null with none.
  /// @throws IoError where the file is missing, unreadable or of another size
  [[nodiscard]] std::shared_ptr<const FramePriors> of(const std::string& image) const;

 private:
  std::filesystem::path folder_;
  double relative_sigma_ = 0;
  int width_ = 0;
  int height_ = 0;
};

}  // namespace dsorb
