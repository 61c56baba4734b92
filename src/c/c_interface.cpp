// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/c/dsorb.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/camera/row_times.h"
#include "dsorb/error.h"
#include "dsorb/image/frame.h"
#include "dsorb/image/frame_priors.h"
#include "dsorb/init/initializer.h"
#include "dsorb/odometry/odometry.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace dsorb::c {
namespace {

template <typename Pointer>
void require(Pointer pointer, const char* name) {
  if (pointer == nullptr) throw std::invalid_argument(std::string(name) + " is NULL");
}

/// Camera of all images of an object.
struct ImageSource {
  PinholeCamera camera;
  std::shared_ptr<const RowTimes> row_times;  ///< nullptr: a global shutter
};

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

}  // namespace
}  // namespace dsorb::c

// NOLINTBEGIN(readability-identifier-naming,readability-function-size): the C interface.
struct dsorb_initializer {
  dsorb::c::ImageSource source;
  std::unique_ptr<dsorb::Initializer> initializer;
  std::vector<dsorb_frame> frames;
  std::vector<dsorb_point> points;
  std::optional<dsorb::MetricScale> metric;
  double wrong_probability = 1;
};

namespace {

/// Keeps the points of the newest keyframe, and whether they are in metres.
class NewestPoints : public dsorb::OdometryObserver {
 public:
  void onInitStep(const dsorb::InitStep& step,
                  const dsorb::Frame& /*frame*/,
                  int /*segment*/) override {
    if (step.result) is_metric = step.result->metric.has_value();
  }
  void onKeyframe(const dsorb::KeyframeSnapshot& keyframe) override {
    if (keyframe.points.empty()) return;
    points.clear();  // the next one is newer
    for (const dsorb::MapPoint& p : keyframe.points) {
      points.push_back({keyframe.id.value, p.pixel.x(), p.pixel.y(), p.inverse_depth, p.variance});
    }
  }

  std::vector<dsorb_point> points;
  bool is_metric = false;
};

}  // namespace

struct dsorb_odometry {
  dsorb::c::ImageSource source;
  NewestPoints newest;
  std::optional<dsorb::Odometry> odometry;
  bool hurried = false;
};

namespace {

void writeError(const char* text, char* error, size_t error_size) {
  if (error == nullptr || error_size == 0) return;
  const std::size_t length = std::min(std::strlen(text), error_size - 1);
  std::memcpy(error, text, length);
  error[length] = 0;
}

/// Turns whatever `call` throws into a status and a text.
template <typename Call>
dsorb_status guarded(char* error, size_t error_size, Call call) noexcept {
  try {
    call();
    return DSORB_OK;
  } catch (const std::invalid_argument& e) {
    writeError(e.what(), error, error_size);
    return DSORB_BAD_ARGUMENT;
  } catch (const dsorb::ConfigError& e) {
    writeError(e.what(), error, error_size);
    return DSORB_BAD_ARGUMENT;
  } catch (const std::logic_error& e) {
    writeError(e.what(), error, error_size);
    return DSORB_WRONG_STATE;
  } catch (const std::exception& e) {
    writeError(e.what(), error, error_size);
    return DSORB_FAILED;
  } catch (...) {
    writeError("an error without a text", error, error_size);
    return DSORB_FAILED;
  }
}

dsorb::InitializerOptions optionsOf(const char* name, int32_t threads) {
  dsorb::c::require(name, "name");
  dsorb::InitializerOptions options = dsorb::initializerVariant(name);
  options.num_threads = threads;
  return options;
}

template <typename T>
size_t copyOut(const std::vector<T>& from, T* out, size_t capacity) {
  if (out != nullptr) std::copy_n(from.begin(), std::min(capacity, from.size()), out);
  return from.size();
}

void keep(const dsorb::InitializationResult& result, dsorb_initializer& handle) {
  handle.metric = result.metric;
  handle.wrong_probability = result.report.wrong_probability.value_or(1);
  for (const dsorb::PosedFrame& posed : result.frames) {
    handle.frames.push_back(dsorb::c::frameOfStart(posed));
  }
  for (const dsorb::InitPoint& p : result.points) {
    handle.points.push_back({p.host, p.pixel.x(), p.pixel.y(), p.inverse_depth, p.variance});
  }
}

}  // namespace

const char* dsorb_version(void) {
  return DSORB_VERSION;
}

dsorb_status dsorb_initializer_create(const char* name,
                                      const dsorb_camera* camera,
                                      int32_t threads,
                                      dsorb_initializer** out,
                                      char* error,
                                      size_t error_size) {
  return guarded(error, error_size, [&] {
    dsorb::c::require(out, "out");
    *out = nullptr;
    auto handle = std::make_unique<dsorb_initializer>();
    handle->source = dsorb::c::sourceOf(camera);
    handle->initializer = dsorb::makeInitializer(optionsOf(name, threads), handle->source.camera);
    *out = handle.release();
  });
}

dsorb_status dsorb_initializer_add(dsorb_initializer* initializer,
                                   const dsorb_image* image,
                                   dsorb_state* state,
                                   char* error,
                                   size_t error_size) {
  return guarded(error, error_size, [&] {
    dsorb::c::require(initializer, "initializer");
    dsorb::c::require(state, "state");
    const dsorb::InitStep step =
        initializer->initializer->addFrame(dsorb::c::frameOf(image, initializer->source));
    initializer->wrong_probability = step.motion ? step.motion->wrong_probability : 1;
    if (step.result) keep(*step.result, *initializer);
    *state = step.result ? DSORB_INITIALIZED : DSORB_INITIALIZING;
  });
}

size_t dsorb_initializer_frames(const dsorb_initializer* initializer,
                                dsorb_frame* out,
                                size_t capacity) {
  return initializer == nullptr ? 0 : copyOut(initializer->frames, out, capacity);
}

size_t dsorb_initializer_points(const dsorb_initializer* initializer,
                                dsorb_point* out,
                                size_t capacity) {
  return initializer == nullptr ? 0 : copyOut(initializer->points, out, capacity);
}

int32_t dsorb_initializer_metric(const dsorb_initializer* initializer,
                                 double* metres,
                                 double* relative_sigma) {
  if (initializer == nullptr || metres == nullptr || !initializer->metric) return 0;
  *metres = initializer->metric->metres;
  if (relative_sigma != nullptr) *relative_sigma = initializer->metric->relative_sigma;
  return 1;
}

double dsorb_initializer_wrong_probability(const dsorb_initializer* initializer) {
  return initializer == nullptr ? 1 : initializer->wrong_probability;
}

void dsorb_initializer_set_hurried(dsorb_initializer* initializer, int32_t hurried) {
  if (initializer != nullptr) initializer->initializer->setHurried(hurried != 0);
}

dsorb_status dsorb_initializer_reset(dsorb_initializer* initializer,
                                     char* error,
                                     size_t error_size) {
  return guarded(error, error_size, [&] {
    dsorb::c::require(initializer, "initializer");
    initializer->initializer->reset();
    initializer->frames.clear();
    initializer->points.clear();
    initializer->metric.reset();
    initializer->wrong_probability = 1;
  });
}

void dsorb_initializer_destroy(dsorb_initializer* initializer) {
  delete initializer;
}

dsorb_status dsorb_odometry_create(const char* name,
                                   const dsorb_camera* camera,
                                   int32_t threads,
                                   dsorb_odometry** out,
                                   char* error,
                                   size_t error_size) {
  return guarded(error, error_size, [&] {
    dsorb::c::require(out, "out");
    *out = nullptr;
    auto handle = std::make_unique<dsorb_odometry>();
    handle->source = dsorb::c::sourceOf(camera);
    dsorb::OdometryOptions options;
    options.initializer = optionsOf(name, threads);
    options.num_threads = threads;
    handle->odometry.emplace(handle->source.camera, options);
    handle->odometry->addObserver(&handle->newest);
    *out = handle.release();
  });
}

dsorb_status dsorb_odometry_add(dsorb_odometry* odometry,
                                const dsorb_image* image,
                                dsorb_estimate* estimate,
                                char* error,
                                size_t error_size) {
  return guarded(error, error_size, [&] {
    dsorb::c::require(odometry, "odometry");
    dsorb::c::require(estimate, "estimate");
    const dsorb::FrameEstimate made =
        odometry->odometry->process(dsorb::c::frameOf(image, odometry->source), odometry->hurried);
    *estimate = dsorb::c::estimateOf(made);
    estimate->is_metric = made.T_world_cam && odometry->newest.is_metric ? 1 : 0;
  });
}

void dsorb_odometry_set_hurried(dsorb_odometry* odometry, int32_t hurried) {
  if (odometry != nullptr) odometry->hurried = hurried != 0;
}

size_t dsorb_odometry_points(const dsorb_odometry* odometry, dsorb_point* out, size_t capacity) {
  return odometry == nullptr ? 0 : copyOut(odometry->newest.points, out, capacity);
}

dsorb_status dsorb_odometry_restart(dsorb_odometry* odometry, char* error, size_t error_size) {
  return guarded(error, error_size, [&] {
    dsorb::c::require(odometry, "odometry");
    odometry->odometry->restart();
    odometry->newest.points.clear();
  });
}

void dsorb_odometry_destroy(dsorb_odometry* odometry) {
  delete odometry;
}
// NOLINTEND(readability-identifier-naming,readability-function-size)
