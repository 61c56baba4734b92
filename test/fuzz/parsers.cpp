// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/parsers.h"

#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"
#include "dsorb/io/config.h"

#include "camera/undistorter.h"
#include "io/input/dataset.h"
#include "io/input/image_decoder.h"
#include "io/input/image_source.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <system_error>

namespace dsorb::fuzz {
namespace {

namespace fs = std::filesystem;

/// A folder of this process with three image names, in memory where there is such a disk.
class Folder {
 public:
  Folder() {
    const fs::path memory = "/dev/shm";
    path_ = (fs::is_directory(memory) ? memory : fs::temp_directory_path()) /
            ("dsorb_fuzz_" + std::to_string(getpid()));
    fs::create_directories(path_ / "images");
    for (const char* name : {"000000.png", "000001.png", "000002.png"}) {
      std::ofstream(path_ / "images" / name) << "not read";
    }
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

const fs::path& folder() {
  static const Folder kFolder;
  return kFolder.path();
}

/// The bytes as a file of this name.
fs::path fileOf(const std::uint8_t* bytes, std::size_t size, const char* name) {
  const fs::path file = folder() / name;
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream.write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  return file;
}

/// Calls f; only the errors that a file may cause do not go on.
template <typename F>
void refusing(F f) {
  try {
    f();
  } catch (const IoError&) {
  } catch (const ConfigError&) {
  }
}

void readLensOf(const fs::path& file) {
  for (const char* camera : {"image_0", "image_02", "/cam1/image_raw"}) {
    refusing([&] {
      const Calibration calibration = readCalibration(file, {camera, file});
      if (calibration.lens.width == 0) return;  // KITTI
      try {
        refuseImpossibleLens(calibration.lens);
      } catch (const std::invalid_argument&) {
      }
    });
  }
}

/// camera.txt of DSO, calib.txt and calib_cam_to_cam.txt of KITTI and cameras.txt of COLMAP.
void calibration(const std::uint8_t* bytes, std::size_t size) {
  readLensOf(fileOf(bytes, size, "camera.txt"));
}

/// sensor.yaml of EuRoC, camchain.yaml of Kalibr, camera_info of ROS, YAML of OpenCV, settings of
/// ORB-SLAM, stella_vslam, VINS and SVO.
void calibrationYaml(const std::uint8_t* bytes, std::size_t size) {
  readLensOf(fileOf(bytes, size, "sensor.yaml"));
}

/// Calibrations of nerfstudio and Basalt.
void calibrationJson(const std::uint8_t* bytes, std::size_t size) {
  readLensOf(fileOf(bytes, size, "transforms.json"));
}

/// XML of OpenCV.
void calibrationXml(const std::uint8_t* bytes, std::size_t size) {
  readLensOf(fileOf(bytes, size, "camera.xml"));
}

void response(const std::uint8_t* bytes, std::size_t size) {
  refusing([&] { (void)readResponse(fileOf(bytes, size, "pcalib.txt")); });
}

/// times.txt of DSO and KITTI, of three images.
void times(const std::uint8_t* bytes, std::size_t size) {
  DatasetLayout layout;
  layout.times = fileOf(bytes, size, "times.txt");
  layout.images = folder() / "images";
  for (const SequenceFormat format : {SequenceFormat::kDso, SequenceFormat::kKitti}) {
    layout.format = format;
    refusing([&] { (void)openDataset(layout); });
  }
}

/// data.csv of EuRoC and rgb.txt of TUM RGB-D.
void lists(const std::uint8_t* bytes, std::size_t size) {
  DatasetLayout layout;
  layout.images = fileOf(bytes, size, "list.txt");
  for (const SequenceFormat format : {SequenceFormat::kEuroc, SequenceFormat::kTum}) {
    layout.format = format;
    refusing([&] { (void)openDataset(layout); });
  }
}

void config(const std::uint8_t* bytes, std::size_t size) {
  ConfigSources sources;
  sources.preset = "fast";  // a short one, it is read anew each time
  sources.files = {fileOf(bytes, size, "config.yaml").string()};
  refusing([&] { (void)loadConfig(sources); });
}

void zip(const std::uint8_t* bytes, std::size_t size) {
  refusing([&] {
    const auto images = openImageStore(fileOf(bytes, size, "images.zip"));
    for (int i = 0; i < images->size(); ++i) refusing([&] { (void)images->image(i); });
  });
}

void image(const std::uint8_t* bytes, std::size_t size) {
  refusing([&] { (void)decodeGrey({bytes, bytes + size}, "image"); });
}

/// Containers that FFmpeg reads, and where one lacks its index.
void video(const std::uint8_t* bytes, std::size_t size) {
  refusing([&] {
    const auto images = openVideo(fileOf(bytes, size, "clip.mp4"));
    constexpr int kMost = 10;
    for (int i = 0; i < kMost && images->image(i); ++i) continue;
  });
}

}  // namespace

const std::vector<Parser>& parsers() {
  static const std::vector<Parser> kParsers = {{"calibration", calibration},
                                               {"calibration_yaml", calibrationYaml},
                                               {"calibration_json", calibrationJson},
                                               {"calibration_xml", calibrationXml},
                                               {"response", response},
                                               {"times", times},
                                               {"lists", lists},
                                               {"config", config},
                                               {"zip", zip},
                                               {"image", image},
                                               {"video", video}};
  return kParsers;
}

}  // namespace dsorb::fuzz
