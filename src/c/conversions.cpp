// SPDX-License-Identifier: BSD-3-Clause
#include "c/conversions.h"

#include "dsorb/image/frame_priors.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

namespace dsorb::c {
namespace {

using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

PosePrior poseOf(const dsorb_priors& known) {
  const Eigen::Matrix<double, 3, 4> matrix = Eigen::Map<const RowMajor34>(known.cam_from_since);
  const Eigen::Matrix<double, 6, 6> covariance =
      Eigen::Map<const RowMajor6>(known.motion_covariance);
  const Eigen::Matrix3d of_rotation = covariance.bottomRightCorner<3, 3>();
  const FrameId since{known.motion_since};
  PosePrior rotation = rotationSince(since, matrix.leftCols<3>(), of_rotation);
  if (known.motion != DSORB_POSE) return rotation;
  return poseSince(since, {rotation.T_frame_since.rotationMatrix(), matrix.col(3)}, covariance);
}

std::shared_ptr<const FramePriors> priorsOf(const dsorb_priors* known,
                                            const PinholeCamera& camera) {
  if (known == nullptr) return nullptr;
  auto priors = std::make_shared<FramePriors>();
  if (known->depths != nullptr) {
    priors->depth = denseDepth({known->depths, camera.width, camera.height},
                               known->depth_sigma,
                               known->depth_relative_sigma);
  } else if (known->samples != nullptr) {
    std::vector<DepthAtPixel> samples;
    for (std::size_t i = 0; i < known->sample_count; ++i) {
      const dsorb_depth& one = known->samples[i];
      samples.push_back({one.x, one.y, one.depth, one.sigma});
    }
    priors->depth = sparseDepth(camera.width, camera.height, samples);
  }
  if (priors->depth) priors->depth->metric = known->depth_scale_unknown == 0;
  if (known->motion != DSORB_NO_MOTION) priors->pose = poseOf(*known);
  if (known->has_distance != 0) {
    priors->distance =
        DistancePrior{FrameId{known->distance_since}, known->distance, known->distance_sigma};
  }
  return priors;
}

/// The image with NaN where the mask is 0.
std::vector<float> maskedPixels(const ImageView& image, const ImageView& mask) {
  std::vector<float> pixels;
  for (int y = 0; y < image.height(); ++y) {
    const auto* row = image.row<std::uint8_t>(y);
    std::transform(row,
                   row + image.width(),
                   mask.row<std::uint8_t>(y),
                   std::back_inserter(pixels),
                   [](std::uint8_t grey, std::uint8_t valid) {
                     return valid != 0 ? static_cast<float>(grey)
                                       : std::numeric_limits<float>::quiet_NaN();
                   });
  }
  return pixels;
}

void writePose(const SE3& pose, double (&out)[12]) {
  const Eigen::Matrix4d matrix = pose.matrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) out[4 * row + column] = matrix(row, column);
  }
}

dsorb_state stateOf(OdometryState state) {
  switch (state) {
    case OdometryState::kInitialized:
      return DSORB_INITIALIZED;
    case OdometryState::kTracked:
      return DSORB_TRACKED;
    case OdometryState::kLost:
      return DSORB_LOST;
    case OdometryState::kMissed:
      return DSORB_MISSED;
    case OdometryState::kInitializing:
      break;
  }
  return DSORB_INITIALIZING;
}

}  // namespace

ImageSource sourceOf(const dsorb_camera* camera) {
  require(camera, "camera");
  const PinholeCamera pinhole{
      camera->fx, camera->fy, camera->cx, camera->cy, camera->width, camera->height};
  const Readout readout{1e-3 * camera->readout_ms, 1e-3 * camera->readout_sigma_ms};
  constexpr double kLongest = 1;  // [s]
  if (!(std::abs(readout.seconds) <= kLongest) || !(readout.sigma >= 0) ||
      !(readout.sigma <= kLongest)) {
    throw std::invalid_argument(
        "readout_ms and readout_sigma_ms must be at most 1000, sigma not negative");
  }
  if (!readout.isRolling()) return {pinhole, nullptr};
  Lens lens;
  lens.width = pinhole.width;
  lens.height = pinhole.height;
  lens.readout = readout;
  lens.columns = camera->columns != 0;
  return {pinhole, std::make_shared<const RowTimes>(rowTimes(lens, pinhole, false))};
}

FramePtr frameOf(const dsorb_image* image, const ImageSource& source) {
  const PinholeCamera& camera = source.camera;
  require(image, "image");
  require(image->data, "the image's data");
  if (image->id < 0) throw std::invalid_argument("the image's id is below 0: expected 0 or above");
  const ImageView view(image->data, camera.width, camera.height, image->stride);
  const double exposure = image->exposure == 0 ? 1 : image->exposure;
  FrameInfo info{FrameId{image->id}, image->timestamp, exposure};
  info.row_times = source.row_times;
  info.priors = priorsOf(image->priors, camera);
  if (image->mask == nullptr) return Frame::create(view, info);
  const ImageView mask(image->mask, camera.width, camera.height, image->mask_stride);
  const std::vector<float> pixels = maskedPixels(view, mask);
  return Frame::create({pixels.data(), camera.width, camera.height}, info);
}

dsorb_frame frameOfStart(const PosedFrame& posed) {
  dsorb_frame frame{};
  frame.id = posed.frame->id().value;
  frame.timestamp = posed.frame->timestamp();
  if (posed.T_cam_ref) {
    frame.posed = 1;
    writePose(*posed.T_cam_ref, frame.cam_from_ref);
    frame.a = posed.affine.a;
    frame.b = posed.affine.b;
  }
  if (posed.covariance) {
    frame.has_covariance = 1;
    std::copy_n(posed.covariance->data(), posed.covariance->size(), frame.covariance);
  }
  return frame;
}
dsorb_estimate estimateOf(const FrameEstimate& made) {
  dsorb_estimate estimate{};
  estimate.state = stateOf(made.state);
  estimate.is_keyframe = made.is_keyframe ? 1 : 0;
  estimate.segment = made.segment;
  estimate.keyframe = made.keyframe ? made.keyframe->value : -1;
  if (made.T_world_cam) {
    estimate.has_pose = 1;
    writePose(*made.T_world_cam, estimate.world_from_cam);
  }
  if (made.T_cam_keyframe) writePose(*made.T_cam_keyframe, estimate.cam_from_keyframe);
  if (made.covariance) {
    estimate.has_covariance = 1;
    std::copy_n(made.covariance->data(), made.covariance->size(), estimate.covariance);
  }
  if (made.world_covariance) {
    estimate.has_world_covariance = 1;
    std::copy_n(
        made.world_covariance->data(), made.world_covariance->size(), estimate.world_covariance);
  }
  return estimate;
}

}  // namespace dsorb::c
