// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "python/arrays.h"
#include "python/bind.h"
#include "python/frame_source.h"
#include "python/unlocked.h"

#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::python {
namespace {

using Floats = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;

constexpr std::array<std::pair<const char*, RectificationMode>, 4> kModes = {
    {{"crop", RectificationMode::kCrop},
     {"full", RectificationMode::kFull},
     {"none", RectificationMode::kNone},
     {"explicit", RectificationMode::kExplicit}}};

const LensModelName& modelOf(const std::string& name) {
  const auto* found = std::find_if(kLensModels.begin(),
                                   kLensModels.end(),
                                   [&name](const LensModelName& m) { return name == m.name; });
  if (found != kLensModels.end()) return *found;
  throw std::invalid_argument("model '" + name +
                              "': expected pinhole, fov, radtan, equidistant, "
                              "rational, double_sphere, eucm or unified");
}

RectificationMode modeOf(const std::string& name) {
  for (const auto& [mode_name, mode] : kModes) {
    if (name == mode_name && mode != RectificationMode::kExplicit) return mode;
  }
  throw std::invalid_argument("rectification '" + name + "': expected crop, full or none");
}

const char* nameOfMode(RectificationMode mode) {
  for (const auto& [name, value] : kModes) {
    if (value == mode) return name;
  }
  return "explicit";
}

/// What describes a lens beside its focal lengths and principal point.
struct LensWords {
  std::string model;
  std::vector<double> coefficients;
  std::optional<std::string> rectification;
};

Calibration calibrationOf(Lens lens, const LensWords& words) {
  const LensModelName& model = modelOf(words.model);
  if (words.coefficients.size() > model.coefficients) {
    throw std::invalid_argument(std::to_string(words.coefficients.size()) +
                                " coefficients: the model " + words.model + " has " +
                                std::to_string(model.coefficients));
  }
  lens.model = model.model;
  std::copy(words.coefficients.begin(), words.coefficients.end(), lens.coefficients.begin());
  Calibration calibration;
  calibration.lens = lens;
  calibration.rectification.mode =
      model.model == LensModel::kPinhole ? RectificationMode::kNone : RectificationMode::kCrop;
  if (words.rectification) calibration.rectification.mode = modeOf(*words.rectification);
  return calibration;
}

void setVignette(Calibration& calibration, const Floats& array) {
  if (array.ndim() != 2) throw std::invalid_argument("vignette: expected (height, width)");
  PhotometricCalibration& photometric = calibration.photometric;
  photometric.vignette.assign(array.data(), array.data() + array.size());
  photometric.vignette_height = static_cast<int>(array.shape(0));
  photometric.vignette_width = static_cast<int>(array.shape(1));
}

void setReadout(Calibration& calibration, double milliseconds, double sigma_ms, bool columns) {
  if (!(std::abs(milliseconds) <= kMaxReadoutMs) || !(sigma_ms >= 0 && sigma_ms <= kMaxReadoutMs)) {
    throw std::invalid_argument("readout of " + std::to_string(milliseconds) + " +- " +
                                std::to_string(sigma_ms) + " ms: expected at most " +
                                std::to_string(static_cast<int>(kMaxReadoutMs)) + " ms");
  }
  calibration.lens.readout = {1e-3 * milliseconds, 1e-3 * sigma_ms};
  calibration.lens.columns = columns;
}

using Rays = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using RawPixels = nb::ndarray<nb::numpy, double, nb::shape<-1, 2>>;

/// NaN for points behind the camera and for rays where the distortion folds back.
RawPixels project(const Calibration& calibration, const Rays& points) {
  const double max_radius = monotoneRadius(calibration.lens);
  std::vector<double> pixels;
  pixels.reserve(2 * points.shape(0));
  for (std::size_t i = 0; i < points.shape(0); ++i) {
    const Eigen::Map<const Eigen::Vector3d> point(points.data() + 3 * i);
    const Eigen::Vector2d ray = point.head<2>() / point.z();
    const bool seen = point.z() > 0 && ray.norm() <= max_radius;
    const Eigen::Vector2d pixel =
        seen ? projectThroughLens(calibration.lens, ray)
             : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
    pixels.insert(pixels.end(), pixel.begin(), pixel.end());
  }
  return arrayOf<RawPixels>(std::move(pixels), {points.shape(0), 2});
}

void bindPinholeCamera(nb::module_& m) {
  nb::class_<PinholeCamera> type(m,
                                 "Camera",
                                 "Rectified pinhole camera in pixels; the centre of the top-left "
                                 "pixel is (0, 0), depth is along the optical axis.");
  type.def(
          "__init__",
          [](PinholeCamera* self,
             double fx,
             double fy,
             double cx,
             double cy,
             int width,
             int height) {
            new (self) PinholeCamera{fx, fy, cx, cy, width, height};
          },
          nb::arg("fx"),
          nb::arg("fy"),
          nb::arg("cx"),
          nb::arg("cy"),
          nb::arg("width"),
          nb::arg("height"))
      .def_static("unknown",
                  &PinholeCamera::unknown,
                  nb::arg("width"),
                  nb::arg("height"),
                  "Of images of which nothing is known: a guess, which Odometry refines.")
      .def_ro("fx", &PinholeCamera::fx)
      .def_ro("fy", &PinholeCamera::fy)
      .def_ro("cx", &PinholeCamera::cx)
      .def_ro("cy", &PinholeCamera::cy)
      .def_ro("width", &PinholeCamera::width)
      .def_ro("height", &PinholeCamera::height)
      .def_ro("focal_sigma",
              &PinholeCamera::focal_sigma,
              "Relative standard deviation of focal lengths that are a guess; 0: a calibration.");
  bindRepr(type, {"fx", "fy", "cx", "cy", "width", "height"});
}

void bindCalibrationMakers(nb::class_<Calibration>& type) {
  type.def(
          "__init__",
          [](Calibration* self,
             double fx,
             double fy,
             double cx,
             double cy,
             int width,
             int height,
             const std::string& model,
             const std::vector<double>& coefficients,
             const std::optional<std::string>& rectification) {
            const Lens lens{LensModel::kPinhole, fx, fy, cx, cy, {}, width, height};
            new (self) Calibration(calibrationOf(lens, {model, coefficients, rectification}));
          },
          nb::arg("fx"),
          nb::arg("fy"),
          nb::arg("cx"),
          nb::arg("cy"),
          nb::arg("width"),
          nb::arg("height"),
          nb::arg("model") = "pinhole",
          nb::arg("coefficients") = std::vector<double>(),
          nb::arg("rectification") = nb::none(),
          "A lens by its numbers [px]. `model`: pinhole, fov, radtan, equidistant, rational, "
          "double_sphere, eucm or unified; `rectification`: crop, full or none "
          "(docs/calibration.md).")
      .def_static(
          "read",
          [](const std::filesystem::path& file, const std::string& camera) {
            return readCalibration(file, {camera, {}});
          },
          nb::arg("file"),
          nb::arg("camera") = "",
          "Any calibration file of docs/calibration.md; for_size gives it an image size where the "
          "file has none. `camera` chooses one of several, as the file calls it. Raises IoError.")
      .def_static(
          "from_hfov",
          [](double degrees, int width, int height) {
            Calibration calibration;
            calibration.lens = lensOfFieldOfView(degrees, width, height);
            calibration.rectification.mode = RectificationMode::kNone;
            return calibration;
          },
          nb::arg("degrees"),
          nb::arg("width"),
          nb::arg("height"),
          "Lens without distortion that sees about so much from its left to its right edge: a "
          "guess, "
          "which Odometry refines.")
      .def_static(
          "unknown",
          [](int width, int height) {
            Calibration calibration;
            calibration.lens = unknownLens(width, height);
            calibration.rectification.mode = RectificationMode::kNone;
            return calibration;
          },
          nb::arg("width"),
          nb::arg("height"),
          "Lens of which nothing is known but the size of its images: a guess, which Odometry "
          "refines.");
}

void bindCalibration(nb::module_& m) {
  nb::class_<Calibration> type(m, "Calibration", "Lens of a camera and what is rectified for.");
  bindCalibrationMakers(type);
  bindRepr(type,
           {"model", "fx", "fy", "cx", "cy", "coefficients", "width", "height", "rectification"});
  type.def("for_size",
           &calibrationForSize,
           nb::arg("width"),
           nb::arg("height"),
           "The same camera where images are stored in another size.")
      .def("with_output_width",
           &withOutputWidth,
           nb::arg("width"),
           "The same calibration with smaller rectified images.")
      .def("project",
           &project,
           nb::arg("points"),
           "(n, 3) camera coordinates to (n, 2) pixels of the images as they are taken; NaN where "
           "the lens does not see a point.")
      .def_prop_ro("model", [](const Calibration& c) { return nameOf(c.lens.model).name; })
      .def_prop_ro("fx", [](const Calibration& c) { return c.lens.fx; })
      .def_prop_ro("fy", [](const Calibration& c) { return c.lens.fy; })
      .def_prop_ro("cx", [](const Calibration& c) { return c.lens.cx; })
      .def_prop_ro("cy", [](const Calibration& c) { return c.lens.cy; })
      .def_prop_ro("coefficients", [](const Calibration& c) { return coefficientsOf(c.lens); })
      .def_prop_ro("width", [](const Calibration& c) { return c.lens.width; })
      .def_prop_ro("height", [](const Calibration& c) { return c.lens.height; })
      .def_prop_ro("readout_ms", [](const Calibration& c) { return 1e3 * c.lens.readout.seconds; })
      .def_prop_ro("readout_sigma_ms",
                   [](const Calibration& c) { return 1e3 * c.lens.readout.sigma; })
      .def("set_readout",
           &setReadout,
           nb::arg("milliseconds"),
           nb::arg("sigma_ms") = 0.0,
           nb::arg("columns") = false,
           "Rolling shutter: time from the first to the last row (or column), below 0 where the "
           "last one comes first. With `sigma_ms` above 0 it is estimated; (0, 20) knows nothing.")
      .def_prop_ro("rectification",
                   [](const Calibration& c) { return nameOfMode(c.rectification.mode); })
      .def(
          "set_response",
          [](Calibration& c, std::vector<float> table) {
            c.photometric.response = std::move(table);
          },
          nb::arg("table"),
          "Irradiance 0..255 by raw grey value, at least 256 increasing numbers.")
      .def("set_vignette",
           &setVignette,
           nb::arg("attenuation"),
           "(height, width) of float32, 0..1, of the size of the camera's images.");
}

using RectifiedArray = nb::ndarray<nb::numpy, float, nb::ndim<2>>;

RectifiedArray rectify(LockedRectifier& self,
                       nb::handle image,
                       const std::optional<AnyArray>& mask,
                       bool rgb) {
  const AnyArray array = arrayFrom(image);
  const RawImage raw = rawView(array, rgb);
  const Mask valid(mask);
  const PinholeCamera& camera = self.rectifier.camera();
  const auto width = static_cast<std::size_t>(camera.width);
  const auto height = static_cast<std::size_t>(camera.height);
  std::vector<float> pixels;
  pixels.reserve(width * height);
  {
    const Unlocked unlocked;
    const std::lock_guard<std::mutex> lock(self.mutex);
    const ImageView view = self.rectifier.rectify(raw, valid.view());
    for (int y = 0; y < camera.height; ++y) {
      pixels.insert(pixels.end(), view.row<float>(y), view.row<float>(y) + width);
    }
  }
  return arrayOf<RectifiedArray>(std::move(pixels), {height, width});
}

void bindRectifier(nb::module_& m) {
  nb::class_<LockedRectifier> type(m,
                                   "Rectifier",
                                   "Turns images as a camera gives them into rectified grey "
                                   "images: photometric correction, mask, undistortion.");
  bindRepr(type, {"camera", "input_width", "input_height"});
  type.def(nb::init<const Calibration&>(), nb::arg("calibration"))
      .def_prop_ro(
          "camera",
          [](const LockedRectifier& self) { return self.rectifier.camera(); },
          "Camera of the rectified images.")
      .def_prop_ro("input_width",
                   [](const LockedRectifier& self) { return self.rectifier.inputWidth(); })
      .def_prop_ro("input_height",
                   [](const LockedRectifier& self) { return self.rectifier.inputHeight(); })
      .def_prop_ro(
          "warnings",
          [](const LockedRectifier& self) { return self.rectifier.warnings(); },
          "What is odd about the calibration.")
      .def(
          "set_bits",
          [](LockedRectifier& self, int bits) {
            const std::lock_guard<std::mutex> lock(self.mutex);
            self.rectifier.setBits(bits);
          },
          nb::arg("bits"),
          "Of uint16 images, 9 to 16.")
      .def(
          "set_mask",
          [](LockedRectifier& self, const std::optional<AnyArray>& mask) {
            const Mask valid(mask);
            const std::lock_guard<std::mutex> lock(self.mutex);
            self.rectifier.setMask(valid.view());
          },
          nb::arg("mask").none(),
          "(height, width) of bool, or of uint8 and below 128 where no image is valid; or None.")
      .def("rectify",
           &rectify,
           nb::arg("image"),
           nb::arg("mask") = nb::none(),
           nb::kw_only(),
           nb::arg("rgb") = false,
           "Image of the camera, (height, width) of uint8 or uint16, or (height, width, 3) of "
           "uint8 (blue first, or red first with `rgb`). Returns (height, width) of float32, a new "
           "array, NaN where invalid.");
}

}  // namespace

void bindCamera(nb::module_& m) {
  bindPinholeCamera(m);
  bindCalibration(m);
  bindRectifier(m);
}

}  // namespace dsorb::python
