// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"
#include "dsorb/options/orb_mapping.h"

#include "estimate/epipolar_geometry.h"
#include "estimate/rolling_shutter.h"
#include "image/photometric.h"
#include "init/orb/semi_dense/corner_prior.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Epipolar line of one reference pixel. Positions along it are pixels from `origin`, growing with
/// the inverse depth.
class EpipolarLine {
 public:
  /// @param pixel         in the reference
  /// @param inverse_depth where `origin` and the warp are taken [1/unit]
  /// @return nullopt behind the camera or where the line has no direction (at the epipole)
  static std::optional<EpipolarLine> through(const EpipolarGeometry& geometry,
                                             const Eigen::Vector2f& pixel,
                                             float inverse_depth);

  [[nodiscard]] const Eigen::Vector2f& origin() const { return origin_; }
  [[nodiscard]] const Eigen::Vector2f& direction() const { return direction_; }
  /// d pixel / d reference pixel at the inverse depth of `origin`, which is held constant.
  [[nodiscard]] const Eigen::Matrix2f& warp() const { return warp_; }
  /// d position / d inverse depth at `origin` [px unit].
  [[nodiscard]] float speed() const { return speed_; }

  [[nodiscard]] Eigen::Vector2f at(float position) const { return origin_ + position * direction_; }
  /// Position of an inverse depth [px]; nullopt behind the camera.
  [[nodiscard]] std::optional<float> positionOf(float inverse_depth) const;
  /// Inverse depth at a position and its derivative there.
  struct Depth {
    float inverse_depth;  ///< [1/unit]
    float alpha;          ///< d inverse depth / d position [1/(unit px)]
  };
  [[nodiscard]] Depth depthAt(float position) const;

 private:
  EpipolarLine() = default;

  Eigen::Vector3f at_infinity_{0, 0, 1};  ///< A (x, y, 1)
  Eigen::Vector3f b_{0, 0, 0};
  Eigen::Vector2f origin_{0, 0};
  Eigen::Vector2f direction_{1, 0};
  Eigen::Matrix2f warp_ = Eigen::Matrix2f::Identity();
  float speed_ = 0;
};

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
  std::optional<RollingShutter> shutter{};
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
                 const SemiDenseOptions& options,
                 const std::optional<RollingShutter>& reference_shutter = {});

  /// @param prior pixel of the reference, its residual pattern inside the image, and what is known
  ///              of its inverse depth: the search covers kSearchSigmas to both sides
  /// @return observed inverse depth with the variance
  ///         alpha^2 (sigma_geo^2 + sigma_photo^2), alpha = d inverse depth / d position
  /// @source Engel, Sturm, Cremers, ICCV 2013, section 2.2 (geometric and photometric disparity
  ///         error); the geometric part from the pose covariance
  [[nodiscard]] SearchOutcome search(const SemiDensePoint& prior, Scratch& scratch) const;

 private:
  [[nodiscard]] Eigen::Vector2f shiftToRow(const Eigen::Vector2f& pixel, float inverse_depth) const;
  [[nodiscard]] EpipolarLine::Depth depthOf(const EpipolarLine& line,
                                            float position,
                                            const Eigen::Vector2f& shift) const;

  const PyramidLevel& reference_;
  const PyramidLevel& target_;
  const SearchFrame& frame_;
  const PinholeCamera& camera_;
  const SemiDenseOptions& options_;
  EpipolarGeometry geometry_;
  float max_half_length_;  ///< [px]
  std::optional<RollingShutter> reference_shutter_;
};

}  // namespace dsorb::init_orb
