// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/io/calibration_reader.h"

#include "io/calibration/keyed_values.h"

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

// What all forms of calibration files have in common. What is wrong is thrown as the IoError that a
// Complain makes of it, which names file, line and key.
namespace dsorb {

constexpr double kMaxSize = 65536;  ///< of an image [px] a side

/// A lens model as a program calls it, and its parameters in the order or with the keys that it has
/// there: names as "fx fy cx cy k1 [k2]", where those behind the bracket may be missing, of
/// setParameter(), or "key=name".
struct LensWord {
  std::string_view word;  ///< in large or small letters
  LensModel model;
  std::string_view parameters;
};

/// The model of a word.
[[nodiscard]] const LensWord& findLens(const std::vector<LensWord>& models,
                                       const std::string& word,
                                       const Complain& complain);

/// Whole numbers from 1 to 65536.
void setSize(double width, double height, Lens& lens, const Complain& complain);
/// The size by the keys that programs have for it, where they are there.
void readSize(const io::KeyedValues& values, Lens& lens);
/// The size as a list of width and height.
void readSize(const io::KeyedValues& values, const std::string& key, Lens& lens);

/// A parameter of a lens: fx, fy (f: both), cx, cy, or a coefficient as nameOf(model) has them;
/// others must be 0.
void setParameter(std::string_view name, double value, Lens& lens, const Complain& complain);
/// Parameters in the order of a list.
void setParameters(std::string_view list,
                   const std::vector<double>& values,
                   Lens& lens,
                   const Complain& complain);
/// Parameters by keys of their own.
/// @param groups that a key may stand in, each with the dot behind it
/// @return key of the first one
std::string readParameters(const io::KeyedValues& values,
                           std::string_view list,
                           Lens& lens,
                           const std::vector<std::string>& groups = {""});

/// Focal lengths, the range of a sphere's coefficients, and a principal point inside of the image,
/// where its size is known.
void checkLens(const Lens& lens, const Complain& complain);

/// What setReadout() reads.
inline constexpr const char* kReadoutForm =
    "milliseconds from the first to the last row, -1000 to 1000, or auto, and perhaps 'columns'";
/// The readout as calibrations write it: parseReadout(), and perhaps "columns" behind it.
/// @return false where the text is another
[[nodiscard]] bool setReadout(std::string_view text, Lens& lens);

/// A calibration, once its lens was checked and is of the plainest model that says the same: images
/// without a distortion are not resampled.
[[nodiscard]] Calibration finished(Lens lens, const Complain& complain);
inline constexpr const char* kReadoutKey = "readout_ms";
/// The same with the readout that this key may say.
[[nodiscard]] Calibration finished(const io::KeyedValues& values,
                                   const std::string& key,
                                   const Lens& lens);

/// One camera of a calibration file.
struct NamedCamera {
  std::vector<std::string> names;  ///< the first one is that of messages; empty: it has none
  std::function<Calibration()> read;
};

/// The calibration of the camera that is chosen, or of all where they are the same.
/// @throws IoError that lists them where none is chosen, or one that is not there
[[nodiscard]] Calibration readChosen(const std::filesystem::path& file,
                                     const std::vector<NamedCamera>& cameras,
                                     const CameraChoice& choice);

/// Lens of a YAML, JSON or XML file of any program that is known.
[[nodiscard]] Calibration readKeyed(const io::KeyedValues& values, const CameraChoice& choice);

}  // namespace dsorb
