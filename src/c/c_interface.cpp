// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/c/dsorb.h"
#include "dsorb/error.h"
#include "dsorb/odometry/odometry.h"

#include "c/conversions.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <vector>

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
