// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"

#include "geometry/row_motion.h"
#include "image/photometric.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb::track {

/// Points of one pyramid level, contiguous arrays of equal length.
struct ReferencePoints {
  std::vector<float> ray_x;          ///< ray through the pixel, z = 1
  std::vector<float> ray_y;          ///<
  std::vector<float> inverse_depth;  ///< [1/unit]
  std::vector<float> intensity;      ///< in the reference, level of the list [grey levels]

  [[nodiscard]] std::size_t size() const { return ray_x.size(); }
  void clear();
  void append(float x, float y, float depth, float grey);
};

/// Weighted sums of inverse depths on the pixels of one level.
struct DepthAccumulator {
  int width = 0;
  int height = 0;
  std::vector<float> weighted_depth;
  std::vector<float> weight;

  /// Values are undefined afterwards.
  void resize(int new_width, int new_height);
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

/// Reference that frames are tracked against: sparse inverse depths of a frame on every pyramid
/// level. On
/// level 0 the samples keep their exact positions and are widened to the pixels diagonal to them;
/// on coarser levels the samples are averaged on pixels.
/// @source front end of DSO as published, with exact positions on level 0
class TrackingReference {
 public:
  /// Takes all memory it needs for frames of the camera.
  explicit TrackingReference(const PinholeCamera& camera);

  /// Of the next content; of the same size as the camera before.
  void setCamera(const PinholeCamera& camera) { camera_ = camera; }
  /// Replaces the previous content, keeping the buffers.
  /// @param samples pixels of `frame` with inverse depth; those outside the image or not positive
  ///        are ignored
  /// @param motion  of the frame while its rows are read; without a meaning for a global shutter
  /// @param readout_change over the calibrated readout, of all frames [s]
  void set(const FramePtr& frame,
           const std::vector<DepthSample>& samples,
           const AffineBrightness& affine,
           const RowMotion& motion = {},
           double readout_change = 0);

  [[nodiscard]] const Frame& frame() const { return *frame_; }
  [[nodiscard]] bool empty() const { return frame_ == nullptr; }
  [[nodiscard]] const AffineBrightness& affine() const { return affine_; }
  [[nodiscard]] double readoutChange() const { return readout_change_; }
  [[nodiscard]] int levels() const { return static_cast<int>(points_.size()); }
  [[nodiscard]] const ReferencePoints& points(int level) const {
    return points_[static_cast<std::size_t>(level)];
  }

 private:
  void sortIntoRows(const std::vector<DepthSample>& samples);
  void listFinest();
  void listCoarse(int level);
  /// Turns the rays of a level into those of the middle row.
  void moveToMiddle(int level);

  PinholeCamera camera_;
  FramePtr frame_;
  AffineBrightness affine_;
  RowMotion motion_;
  double readout_change_ = 0;
  std::vector<ReferencePoints> points_;   // by level
  std::vector<DepthAccumulator> maps_;    // by level
  std::vector<DepthSample> sorted_;       // usable samples in raster order of their pixels
  std::vector<std::uint32_t> row_begin_;  // first sample of each pixel row in sorted_
};

}  // namespace dsorb::track
