// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"

#include "estimate/rolling_shutter.h"
#include "geometry/row_motion.h"
#include "image/photometric.h"

#include <cstddef>
#include <vector>

namespace dsorb::track {

/// Points of one pyramid level, contiguous arrays of equal length.
struct ReferencePoints {
  std::vector<float> ray_x;          ///< ray through the pixel, z = 1
  std::vector<float> ray_y;          ///<
  std::vector<float> inverse_depth;  ///< [1/unit]
  std::vector<float> intensity;      ///< in the reference, level of the list [grey levels]

  [[nodiscard]] std::size_t size() const { return ray_x.size(); }
  void reserve(std::size_t points);
  void append(float x, float y, float depth, float grey);
};

/// Weighted sums of inverse depths on the pixels of one level.
struct DepthAccumulator {
  int width = 0;
  int height = 0;
  std::vector<float> weighted_depth;
  std::vector<float> weight;

  /// Everything 0.
  void reset(int new_width, int new_height);
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
};

/// Sums of the 2 x 2 blocks of a level.
void accumulateBlocks(const DepthAccumulator& fine, DepthAccumulator& coarse);

/// Neighbours a pixel without weight takes depth from.
enum class DilationNeighbours { kDiagonal, kDirect };

/// Gives pixels without weight the mean depth and weight sums of their neighbours that had weight
/// before the call; the outermost rows and columns are left alone. Both sums of such a pixel get a
/// negative sign, which marks it and leaves their quotient right.
void dilate(DepthAccumulator& level, DilationNeighbours neighbours);

/// What frames are tracked against: a frame with sparse inverse depths on every pyramid level.
struct TrackingReference {
  FramePtr frame;        ///< null: there is none
  PinholeCamera camera;  ///< of the reference and the frames
  AffineBrightness affine;
  RowMotion motion{};     ///< of the frame while the rows of a rolling shutter are read
  CameraChange change{};  ///< over the calibrated camera, of all frames
  std::vector<ReferencePoints> points{};  ///< by level

  [[nodiscard]] int levels() const { return static_cast<int>(points.size()); }
  [[nodiscard]] const ReferencePoints& at(int level) const {
    return points[static_cast<std::size_t>(level)];
  }
};

/// Fills references; keeps its buffers from one to the next. On level 0 the samples keep their
/// exact positions (else trajectories in rendered rooms are 1.08 +- .02 times as wrong) and are
/// widened to the pixels diagonal to them; on coarser levels they are averaged on pixels.
/// @source front end of DSO as published, with exact positions on level 0
class TrackingReferenceBuilder {
 public:
  /// @param camera of the size of all that are to come
  explicit TrackingReferenceBuilder(const PinholeCamera& camera);

  /// Sets the points of a reference.
  /// @param samples pixels of its frame with inverse depth; those outside the image or not positive
  ///        are ignored
  void fill(const std::vector<DepthSample>& samples, TrackingReference& reference);

 private:
  void keepUsable(const std::vector<DepthSample>& samples, const PyramidLevel& level);
  void list(int level, TrackingReference& reference);

  std::vector<DepthAccumulator> maps_;  // by level
  std::vector<DepthSample> usable_;
};

}  // namespace dsorb::track
