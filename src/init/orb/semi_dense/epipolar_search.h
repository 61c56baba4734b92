// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"
#include "dsorb/options/orb_mapping.h"

#include "image/photometric.h"
#include "init/orb/semi_dense/corner_prior.h"
#include "init/orb/semi_dense/epipolar_line.h"

#include <array>
#include <vector>

namespace dsorb::init_orb {

enum class SearchStatus {
  kSkipped,   ///< outside the image, gradient across the line, or too little motion
  kRejected,  ///< searched without a trustworthy match
  kFound
};

struct SearchOutcome {
  SearchStatus status = SearchStatus::kSkipped;
  SemiDensePoint observation;  ///< when found
};

/// A later frame as the search needs it.
struct SearchFrame {
  FramePtr frame;
  SE3 T_cam_ref;
  Matrix6d covariance = Matrix6d::Zero();  ///< of a left increment, [translation; rotation]
  BrightnessTransfer transfer;             ///< reference to this frame
  double image_noise = kImageNoise;        ///< of one grey value [grey levels]
};

/// Searches pixels of a reference along their epipolar lines in one other frame. Holds references
/// to what it is made of; safe to use from several threads, each with a scratch of its own.
class EpipolarSearch {
 public:
  /// Memory that a thread reuses between searches.
  using Scratch = std::vector<float>;

  EpipolarSearch(const FramePtr& reference,
                 const SearchFrame& target,
                 const PinholeCamera& camera,
                 const SemiDenseOptions& options);

  /// @param prior pixel of the reference, its residual pattern inside the image, and what is known
  ///              of its inverse depth: the search covers kSearchSigmas to both sides
  /// @return observed inverse depth with the variance
  ///         alpha^2 (sigma_geo^2 + sigma_photo^2), alpha = d inverse depth / d position
  /// @source Engel, Sturm, Cremers, ICCV 2013, section 2.2 (geometric and photometric disparity
  ///         error); the geometric part from the pose covariance
  [[nodiscard]] SearchOutcome search(const SemiDensePoint& prior, Scratch& scratch) const;

 private:
  /// Reference patch and where its pixels lie in the target around the centre.
  struct Patch {
    std::array<float, kPatternSize> grey;
    std::array<Eigen::Vector2f, kPatternSize> offset;
    float extent = 0;  ///< largest offset along an axis [px]
  };
  struct Interval {
    float begin;
    float end;
  };
  /// Sums over the patch at the match.
  struct Match {
    float position = 0;           ///< on the line [px]
    float information = 0;        ///< sum of squared gradients along the line [grey^2/px^2]
    Eigen::Vector2f shift{0, 0};  ///< d position / d displacement of the line
  };

  [[nodiscard]] bool gradientIsUsable(const Eigen::Vector2f& pixel, const EpipolarLine& line) const;
  [[nodiscard]] Patch cutPatch(const Eigen::Vector2f& pixel, const EpipolarLine& line) const;
  [[nodiscard]] Interval clippedInterval(const EpipolarLine& line,
                                         const SemiDensePoint& prior,
                                         float margin) const;
  [[nodiscard]] float cost(const Patch& patch, const Eigen::Vector2f& centre) const;
  /// @return position of the best step, NaN when there is none or another is about as good
  [[nodiscard]] float bestStep(const Patch& patch,
                               const EpipolarLine& line,
                               const Interval& interval,
                               Scratch& costs) const;
  /// Error and first derivatives of the patch by the position on the line.
  struct Linearization {
    float squared_error = 0;
    float gradient = 0;
    float information = 0;
    Eigen::Vector2f cross{0, 0};  ///< sum of gradient along the line times gradient
  };
  [[nodiscard]] Linearization linearize(const Patch& patch,
                                        const EpipolarLine& line,
                                        float position) const;
  [[nodiscard]] bool refine(const Patch& patch,
                            const EpipolarLine& line,
                            const Interval& interval,
                            Match& match) const;
  [[nodiscard]] float geometricVariance(const Eigen::Vector2f& pixel,
                                        const EpipolarLine& line,
                                        const Match& match,
                                        float inverse_depth) const;

  const PyramidLevel& reference_;
  const PyramidLevel& target_;
  const SearchFrame& frame_;
  const PinholeCamera& camera_;
  const SemiDenseOptions& options_;
  EpipolarGeometry geometry_;
  float max_half_length_;  ///< [px]
};

}  // namespace dsorb::init_orb
